"""From the text of a scenario file to its syntax, without lark until there is a text."""

from vastflow.sim.osc.syntax import FileText


def parse(text: str, file: str) -> FileText:
    """What is written in `text`; the grammar is built once in a process.

    Raises:
        OscError: it is not in the language; every place where it is not that can be told from what follows.
    """
    from vastflow.sim.osc.grammar import parsed  # 0.15 s of CPU that only a process which reads scenarios should pay

    return parsed(text, file)
