"""What `diagnose` found, running in a simulator beside a file that cannot hold it (docs/effects.md).

`laws` has the equations as pure functions, `file` reads `effects.json`, `joint` is what one file lacks at one
joint. `mujoco`, `pybullet` and `drake` apply it; each needs its simulator, and nothing else imports one.
"""

from .file import LAYOUT, Effect, HeldEffects, JointLaw, read_laws
from .joint import JointEffects, direction, joints_lacking
from .laws import State, followed, friction_effort

__all__ = [
    "LAYOUT",
    "Effect",
    "HeldEffects",
    "JointEffects",
    "JointLaw",
    "State",
    "direction",
    "followed",
    "friction_effort",
    "joints_lacking",
    "read_laws",
]
