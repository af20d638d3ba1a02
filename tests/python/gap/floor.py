"""The floor of a real machine: small physics that no catalogue of effects holds, one `Floor` a joint.

How each part is kept from being an effect of the catalogue in disguise:

flexibility   A share of the twin's inertia sits behind a spring and a damper, the encoder and the effort before it. The whole
              inertia stays the twin's. The load of gravity acts before the spring, so that nothing sags.
ripple        Six harmonics over the position whose wave numbers have no common base, of like amplitudes: no one is a `cogging`.
              Three waves a span are the least, so that neither a mean (`constant_bias`) nor a slope (`spring_return`) is left.
spots         Friction of eight places of like height, at random; not a `local_friction`. Their mean over the way is taken off.
warmth        Friction that falls as the joint warms (heated by effort times speed, cooled with a time constant). The deviation is
              about the warmth of the mean run; a cold start leaves a mean of a run's own, the drift that it is meant to be.
              Spots and warmth change a friction that the twin has (`nominal`), never below zero.
drive         The joint gets up to 3 % more or less than is reported, and up to 1 % of drift by warmth. This mean is one that the
              catalogue has (`torque_gain`; as well `inertia` or `encoder_scale`): `explained` says up to which size of those the
              floor is the cause, and the scorer does not count them as false.
filter        The reported effort is the joint's through a filter of first order, 1 to 6 ms. It is late by the filter's lag, which
              `explained` allows as a `delay`.
signals       Position and effort in steps of a quantiser; stamps that jitter by a fraction of the period.
"""

import math

import numpy as np

PARTS = ("flexibility", "ripple", "spots", "warmth", "gain", "filter")
LARGEST_GAIN_ERROR = 0.03
LARGEST_GAIN_DRIFT = 0.01
LARGEST_LAG_S = 6e-3
LARGEST_FLEXIBLE_SHARE = 0.35
LARGEST_FRICTION = 0.3  # of the effort, of the friction that spots and warmth take from
SLIDES = 1e-3  # of the span in a second: slower than this the joint counts as at rest


def rms(x):
    return float(np.sqrt(np.mean(np.square(x)))) if len(x) else 0.0


class Floor:
    """The floor of one joint. Positions rad or m, efforts N m or N, times s. `size` sets the parts' sizes."""

    def __init__(self, rng, low, high, inertia, period_s):
        span = high - low
        self.span, self.period_s, self.whole_inertia = span, period_s, inertia
        weights = rng.dirichlet(np.full(len(PARTS), 4.0))
        self.weight = dict(zip(PARTS, np.sqrt(weights)))
        # Flexibility.
        self.flexible_inertia, self.frequency_hz, self.damping_ratio = 0.0, float(rng.uniform(6, 20)), float(rng.uniform(0.03, 0.1))
        # Ripple.
        waves = (2 * math.pi / span * rng.uniform(3, 30, 6), rng.uniform(0, 2 * math.pi, 6), rng.uniform(0.7, 1.3, 6))
        self.ripple_effort, self.waves = 0.0, np.array(waves).T.tolist()
        # Friction.
        self.nominal, self.spots_effort, self.spots_mean, self.warm_effort = 0.0, 0.0, 0.0, 0.0
        spots = (low + span * rng.uniform(-0.1, 1.1, 8), span * rng.uniform(0.02, 0.06, 8), rng.uniform(0.7, 1.3, 8))
        self.spot_shapes = np.array(spots).T.tolist()
        self.usual_power, self.warming_s = math.inf, float(rng.uniform(5, 30))
        # Drive and signals.
        self.gain_sign, self.gain_error, self.gain_drift, self.lag_s = float(rng.choice([-1, 1])), 0.0, 0.0, 1e-3
        self.position_step, self.effort_step, self.jitter = 0.0, 0.0, 0.0
        self.start(1.0)

    def start(self, warmth):
        """State at the start of a run; `warmth` 1 is the usual one."""
        self.bend, self.bend_speed, self.warm, self.reported = 0.0, 0.0, warmth, None
        self.log = {part: [] for part in PARTS}

    # What the parts are, as functions of the state.

    def ripple(self, q):
        """In units of `ripple_effort`."""
        return sum(h * math.sin(n * q + p) for n, p, h in self.waves)

    def spots(self, q):
        """Without their mean, in units of `spots_effort`."""
        return sum(h * math.exp(-(((q - at) / w) ** 2)) for at, w, h in self.spot_shapes) - self.spots_mean

    def at(self, q):
        """The joint is at `q` in this step."""
        self.ripple_here, self.spots_here = self.ripple_effort * self.ripple(q), self.spots_effort * self.spots(q)

    def bend_force(self):
        """Of the spring and damper on the side of the encoder."""
        rate = 2 * math.pi * self.frequency_hz
        return self.flexible_inertia * (rate**2 * self.bend + 2 * self.damping_ratio * rate * self.bend_speed)

    def friction(self):
        """Bound of the friction, N m or N."""
        return max(0.0, self.nominal + self.spots_here - self.warm_effort * (self.warm - 1))

    def gain(self):
        """Effort at the joint over the effort of the drive."""
        return 1 + self.gain_sign * self.gain_error - self.gain_drift * (self.warm - 1)

    def effort(self):
        """Beside the drive's and the friction: ripple and the spring; N m or N."""
        return self.ripple_here + self.bend_force()

    # What happens in a step.

    def advance(self, v, acceleration, effort, step_s):
        """After a step of `step_s` at the speed `v` with `acceleration` and the drive's `effort`."""
        load = -self.bend_force() / self.flexible_inertia - acceleration if self.flexible_inertia else 0.0
        sliding = math.copysign(1.0, v) if abs(v) > SLIDES * self.span else 0.0
        self.log["flexibility"].append(-self.flexible_inertia * load)
        self.log["ripple"].append(self.ripple_here)
        self.log["spots"].append(-self.spots_here * sliding)
        self.log["warmth"].append(self.warm_effort * (self.warm - 1) * sliding)
        self.log["gain"].append((self.gain() - 1) * effort)
        self.bend_speed += step_s * load
        self.bend += step_s * self.bend_speed
        self.warm += step_s / self.warming_s * (abs(effort * v) / self.usual_power - self.warm)

    def report(self, effort):
        """The next effort of the drive as it is reported, a sample later through the filter."""
        self.reported = effort if self.reported is None else effort + math.exp(-self.period_s / self.lag_s) * (self.reported - effort)
        self.log["filter"].append(effort - self.reported)
        return self.reported

    def quantised(self, position, effort):
        return tuple(step * np.round(x / step) if step else x for x, step in ((position, self.position_step), (effort, self.effort_step)))

    def stamp_errors(self, rng, count):
        """Of the stamps, s; never so large that two change places."""
        return self.period_s * np.clip(self.jitter * rng.standard_normal(count), -0.4, 0.4)

    # Sizes.

    def clear(self):
        """No floor at all."""
        self.flexible_inertia = self.ripple_effort = self.nominal = self.spots_effort = self.warm_effort = self.gain_error = self.gain_drift = 0.0
        self.lag_s = 1e-4

    def size(self, share, q, v, acceleration, effort):
        """Sets the parts so that together they come to `share` of the effort's root mean square, by a motion that was recorded at the
        samples; what a part cannot be is given to ripple and friction."""
        usual = rms(effort)
        wanted = {part: self.weight[part] * share * usual for part in PARTS}
        moving = np.abs(v) > SLIDES * self.span
        self.usual_power = float(np.mean(np.abs(effort * v)))
        self.gain_error = min(LARGEST_GAIN_ERROR, wanted["gain"] / usual)
        self.gain_drift = min(LARGEST_GAIN_DRIFT, 0.3 * self.gain_error)
        self.lag_s = max((s for s in np.linspace(1e-3, LARGEST_LAG_S, 26) if rms(self.late(effort, s)) <= wanted["filter"]), default=1e-3)
        load = self.loaded(acceleration)
        self.flexible_inertia = min(LARGEST_FLEXIBLE_SHARE * self.whole_inertia, wanted["flexibility"] / max(rms(load), 1e-12))
        own = [self.gain_error * usual, rms(self.late(effort, self.lag_s)), self.flexible_inertia * rms(load)]
        rest = math.sqrt(max(0.0, (share * usual) ** 2 - sum(x * x for x in own)))
        linear = ("ripple", "spots", "warmth")
        factor = rest / math.sqrt(sum(wanted[part] ** 2 for part in linear))
        self.ripple_effort = factor * wanted["ripple"] / rms([self.ripple(x) for x in q])
        self.spots_mean = 0.0
        height = np.array([self.spots(x) for x in q])
        self.spots_mean = float(np.mean(height[moving]))
        self.spots_effort = factor * wanted["spots"] / max(rms((height - self.spots_mean) * moving), 1e-12)
        self.warm_effort = factor * wanted["warmth"] / max(rms((self.warmth(v, effort) - 1) * moving), 1e-12)

    def fit(self, share, sizes):
        """Sizes of the parts by factors, once the motion with the floor had `sizes`: it has resonances that the plain one has not."""
        had = {part: max(x, 1e-6) for part, x in sizes["parts"].items()}
        factor = {part: min(2.0, max(0.3, self.weight[part] * share / x)) for part, x in had.items()}
        self.lag_s = min(LARGEST_LAG_S, max(1e-3, self.lag_s * math.sqrt(factor["filter"])))
        before = self.flexible_inertia
        self.flexible_inertia = min(LARGEST_FLEXIBLE_SHARE * self.whole_inertia, before * factor["flexibility"])
        bent = had["flexibility"] * self.flexible_inertia / max(before, 1e-12)
        own = had["gain"] ** 2 + had["filter"] ** 2 * factor["filter"] + bent**2
        # Parts that go together count more than their squares.
        together = sizes["share"] ** 2 - sum(x * x for x in had.values())
        linear = {part: self.weight[part] for part in ("ripple", "spots", "warmth")}
        rest = math.sqrt(max((0.3 * share) ** 2, share**2 - own - together))
        whole = math.sqrt(sum(x * x for x in linear.values()))
        spots, warmth = (min(3.0, max(0.3, rest * linear[part] / whole / had[part])) for part in ("spots", "warmth"))
        # What friction cannot give, ripple does.
        borne = spots * self.spots_effort * self.spots_mean + warmth * self.warm_effort
        shrink = min(1.0, LARGEST_FRICTION * sizes["effort"] / max(borne, 1e-12))
        spots, warmth = shrink * spots, shrink * warmth
        ripple = math.sqrt(max((0.2 * rest) ** 2, rest**2 - (spots * had["spots"]) ** 2 - (warmth * had["warmth"]) ** 2)) / had["ripple"]
        self.ripple_effort *= min(3.0, max(0.3, ripple))
        self.spots_effort *= spots
        self.warm_effort *= warmth

    def sizes(self, reported):
        """Root mean square of the run that was logged last, N m or N, and the shares of it that the floor and its parts were."""
        log = {part: np.array(x)[:: max(1, len(x) // len(reported))] for part, x in self.log.items()}
        usual = rms(reported)
        return dict(share=rms(self.total(len(reported))) / usual, effort=usual, parts={part: rms(x) / usual for part, x in log.items()})

    def total(self, count):
        """Effort of the whole floor at the `count` samples of the run that was logged last, N m or N."""
        return sum(np.array(x)[:: max(1, len(x) // count)] for x in self.log.values())

    def bear(self, least):
        """Sets the friction that the twin has, at least `least`: neither spots nor warmth take it below zero."""
        self.nominal = least + self.spots_effort * self.spots_mean + self.warm_effort

    def late(self, effort, lag_s):
        """Effort of the drive less the reported one."""
        left, out = effort[0], []
        for u in effort:
            left = u + math.exp(-self.period_s / lag_s) * (left - u)
            out.append(u - left)
        return np.array(out)

    def loaded(self, acceleration):
        """Acceleration of the bend that a motion drives; the spring's inertia times it is the effort of the flexibility."""
        rate, step_s, z, w, out = 2 * math.pi * self.frequency_hz, self.period_s / 10, 0.0, 0.0, []
        for a in np.repeat(acceleration, 10):
            out.append(-(rate**2) * z - 2 * self.damping_ratio * rate * w - a)
            w += step_s * out[-1]
            z += step_s * w
        return np.array(out[::10])

    def warmth(self, v, effort):
        """Over a run that starts at 0.6 of the usual warmth."""
        h, out = 0.6, []
        for power in np.abs(effort * v):
            out.append(h)
            h += self.period_s / self.warming_s * (power / self.usual_power - h)
        return np.array(out)

    # What becomes known.

    def lag_mean_s(self):
        """Mean lag of the reported effort."""
        left = math.exp(-self.period_s / self.lag_s)
        return self.period_s * left / (1 - left)

    def explained(self):
        """{effect: {parameter: the furthest from its neutral value}} that this floor is the cause of; `inertia` is in kg m^2 or kg."""
        gain = self.gain_error + self.gain_drift + 0.01
        return {
            "torque_gain": {"gain": gain}, "encoder_scale": {"scale": gain}, "inertia": {"added_inertia": gain * self.whole_inertia},
            "delay": {"delay": self.lag_mean_s() + self.jitter * self.period_s + 1e-3},
        }  # fmt: skip

    def numbers(self):
        """For the truth file."""
        keep = (
            "flexible_inertia", "whole_inertia", "frequency_hz", "damping_ratio", "ripple_effort", "nominal", "spots_effort", "warm_effort",
            "warming_s", "gain_drift", "lag_s", "position_step", "effort_step", "jitter",
        )  # fmt: skip
        return {name: getattr(self, name) for name in keep} | dict(gain=1 + self.gain_sign * self.gain_error)
