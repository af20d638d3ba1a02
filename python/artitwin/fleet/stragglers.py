"""Which running objects take longer than the finished ones let expect.

The measure is time over estimate. With n finished ratios, a running one is a straggler where it exceeds both
every one of them (an order statistic: no assumption) and the upper prediction bound of a lognormal whose
place and spread are median and median absolute deviation of their logarithms, at a level of 0.05 over all
objects together. The bound widens for small n (Student's quantile), so nothing is said before the sample
allows it.
"""

import math
import statistics
from collections.abc import Sequence

_LEVEL = 0.05
"""Chance of one false name in a whole fleet, if ratios are lognormal; the usual level of a test."""
_NORMAL_MAD = 1.4826
"""derived: deviation of a normal over its median absolute deviation."""
_CLOCK_S = 1.0
"""derived: times are read every fraction of a second; ratios of shorter jobs are their rounding."""


def bound(ratios: Sequence[float], objects: int) -> float | None:
    """The ratio of time to estimate above which a running object is a straggler; None: too few ended."""
    n = len(ratios)
    if n < 3:
        return None
    logs = [math.log(ratio) for ratio in ratios if ratio > 0.0]
    if len(logs) < 3:
        return None
    middle = statistics.median(logs)
    spread = _NORMAL_MAD * statistics.median(abs(x - middle) for x in logs)
    quantile = student(1.0 - _LEVEL / max(objects, 1), n - 1)
    reach = middle + quantile * spread * math.sqrt(1.0 + 1.0 / n)
    # Beyond any number: there is no bound yet.
    return max(max(ratios), math.exp(reach)) if reach < 700.0 else None


def is_straggler(seconds: float, estimate: float, bound: float | None) -> bool:
    """Whether an object that has run so long is one."""
    return bound is not None and estimate > 0.0 and seconds > bound * estimate + _CLOCK_S


def student(p: float, freedom: int) -> float:
    """Quantile of Student's distribution for p > 0.5 (G. W. Hill, Algorithm 396, CACM 13, 1970)."""
    n, two_tails = float(freedom), 2.0 * (1.0 - p)
    if freedom == 1:
        return 1.0 / math.tan(two_tails * math.pi / 2.0)
    if freedom == 2:
        return math.sqrt(2.0 / (two_tails * (2.0 - two_tails)) - 2.0)
    a = 1.0 / (n - 0.5)
    b = 48.0 / (a * a)
    c = ((20700.0 * a / b - 98.0) * a - 16.0) * a + 96.36
    d = ((94.5 / (b + c) - 3.0) / b + 1.0) * math.sqrt(a * math.pi / 2.0) * n
    x = d * two_tails
    y = x ** (2.0 / n)
    if y > 0.05 + a:
        x = statistics.NormalDist().inv_cdf(two_tails / 2.0)
        y = x * x
        if freedom < 5:
            c += 0.3 * (n - 4.5) * (x + 0.6)
        c = (((0.05 * d * x - 5.0) * x - 7.0) * x - 2.0) * x + b + c
        y = (((((0.4 * y + 6.3) * y + 36.0) * y + 94.5) / c - y - 3.0) / b + 1.0) * x
        y = math.expm1(a * y * y)
    else:
        y = (
            (1.0 / (((n + 6.0) / (n * y) - 0.089 * d - 0.822) * (n + 2.0) * 3.0) + 0.5 / (n + 4.0)) * y - 1.0
        ) * (n + 1.0) / (n + 2.0) + 1.0 / y
    return math.sqrt(n * y)
