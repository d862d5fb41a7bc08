"""Keys of the system dimension that are known by name."""

from typing import Final, Literal, TypeAlias, get_args

FILE_KEY: Final = "nav2_params"
"""Key that has the system's parameter file."""

SUT: Final = "sut."
"""Begins the key of a parameter in a configuration file of a program: name of the file, and path in it."""

CONTROLLER_KEY: Final = "controller"

KEEPOUT_KEY: Final = "keepout_mask"
SPEED_KEY: Final = "speed_mask"
MASK_KEYS: Final = (KEEPOUT_KEY, SPEED_KEY)
"""Keys that name masks, as Nav2's launch files do. A mask is told to the stack, and is nowhere in the world."""

RECORDING_KEY: Final = "recording"
"""Key that has the recording of a run that was driven elsewhere: it is read, and nothing is simulated."""

COVARIANCE_KEY: Final = "initial_pose_covariance"

Release: TypeAlias = Literal["jazzy", "kilted", "lyrical"]
RELEASES: Final[tuple[Release, ...]] = get_args(Release)
RELEASE_KEY: Final = "nav2_release"
"""Key that says the release of a parameter file."""

FOOTPRINT_NAMES: Final = frozenset({"footprint", "robot_radius", "footprint_padding", "radius", "polygon", "namespace"})
"""Last names of the keys that a robot's footprint can follow from."""


def is_of_footprint(key: str) -> bool:
    """True if a robot's footprint can follow from a key."""
    return key in (FILE_KEY, CONTROLLER_KEY) or key.rpartition(".")[2] in FOOTPRINT_NAMES
