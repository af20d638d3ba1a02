//! From the recorded signal to the effort at the joint: the unit of an effort, or a servo following a
//! commanded position.

/// `effort = gain * e - damping * velocity`, where `e` is the recorded effort, or for a servo `stiffness *
/// (commanded - measured position)`; a servo is limited to `limit`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Actuator {
    /// Factor of the recorded effort, or of the stiffness.
    pub gain: f64,
    /// Damping of the servo, N m s/rad or N s/m.
    pub damping: f64,
    /// The servo, if commanded positions were recorded instead of efforts.
    pub servo: Option<Servo>,
    /// Time from a command to its effect, seconds, in addition to the fitted lag of the stamps.
    pub delay_s: f64,
    /// Factor applied to recorded efforts of unknown unit, before the gain.
    pub unit: f64,
    /// Whether gain and damping are fitted with the effects, as nuisances without findings.
    pub is_found: [bool; 2],
    /// Whether the delay is fitted too.
    pub is_late: bool,
    /// Whether the recorded effort is that of a calibrated sensor, which has no gain to be found.
    pub is_calibrated: bool,
}

/// Relative standard deviation of the gain of a recorded effort.
/// derived: the geometric mean of 1 % (torque sensors) and 10 % (torque constants of motors), from data
/// sheets.
pub const GAIN_DEVIATION: f64 = 0.03;

/// A servo, before the gain is applied.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Servo {
    /// Stiffness, N m/rad or N/m.
    pub stiffness: f64,
    /// Largest effort, N m or N; infinite if unlimited.
    pub limit: f64,
}

/// Effort of an actuator with its derivatives.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Acted {
    /// Effort, N m or N.
    pub effort: f64,
    /// Derivative with respect to the position of the joint.
    pub q: f64,
    /// Derivative with respect to its velocity.
    pub v: f64,
    /// Derivative with respect to the signal: the recorded effort, or the commanded position.
    pub signal: f64,
    /// Derivative with respect to the position read by a servo.
    pub read: f64,
    /// Derivatives with respect to gain and damping.
    pub p: [f64; 2],
}

impl Default for Actuator {
    /// The recorded effort, unchanged.
    fn default() -> Self {
        Self {
            gain: 1.0,
            damping: 0.0,
            servo: None,
            delay_s: 0.0,
            unit: 1.0,
            is_found: [false; 2],
            is_late: false,
            is_calibrated: false,
        }
    }
}

impl Actuator {
    /// The effort for a signal, at a position and a velocity; `measure` is (scale, offset) of the position
    /// read by a servo.
    #[inline]
    pub fn effort_under(&self, signal: f64, q: f64, v: f64, measure: (f64, f64)) -> Acted {
        let Some(servo) = self.servo else {
            let effort = self.gain * signal - self.damping * v;
            return Acted {
                effort,
                v: -self.damping,
                signal: self.gain,
                p: [signal, -v],
                ..Acted::default()
            };
        };
        let wanted = servo.stiffness * (signal - measure.0 * q - measure.1);
        let effort = self.gain * wanted - self.damping * v;
        // A servo at its limit does not respond.
        if effort.abs() > servo.limit {
            return Acted { effort: servo.limit.copysign(effort), ..Acted::default() };
        }
        let stiffness = self.gain * servo.stiffness;
        Acted {
            effort,
            q: -stiffness * measure.0,
            v: -self.damping,
            signal: stiffness,
            read: -stiffness,
            p: [wanted, -v],
        }
    }

    /// Whether it is a recorded effort in a known unit, with the accuracy of its sensor.
    pub fn is_measured(&self) -> bool {
        self.servo.is_none() && !self.is_found[0]
    }

    /// Name in reports.
    pub fn kind(&self) -> &'static str {
        if self.servo.is_some() { "servo" } else { "effort" }
    }

    /// Number of fitted parameters.
    pub fn found_count(&self) -> usize {
        self.is_found.iter().filter(|f| **f).count()
    }

    /// Values of gain and damping, as far as they are fitted.
    pub fn found_values(&self) -> impl Iterator<Item = f64> {
        [self.gain, self.damping].into_iter().zip(self.is_found).filter(|(_, found)| *found).map(|(x, _)| x)
    }

    /// The actuator with other values of the fitted parameters.
    #[must_use]
    pub fn with_found(&self, values: &[f64]) -> Self {
        let mut values = values.iter();
        let mut next = |found: bool, own: f64| if found { *values.next().unwrap_or(&own) } else { own };
        let gain = next(self.is_found[0], self.gain);
        let damping = next(self.is_found[1], self.damping);
        Self { gain, damping, ..*self }
    }
}
