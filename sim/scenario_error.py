"""Why a scenario can't work, which is no verdict on what it tests."""


class ScenarioError(ValueError):
    """A scenario that can't be executed as it stands, such as one whose program can't be started.

    The run is not recorded and not judged: that the scenario can't work says nothing of the system under test. The message says
    where, what was found, and what would be right.
    """
