"""Compare the table of declared defaults with Nav2's source: `python tests/proofs/nav2_defaults.py NAVIGATION2`.

NAVIGATION2, or the environment variable of the name, is a checkout of the table's release:
`git clone --branch 1.3.12 https://github.com/ros-navigation/navigation2`. Each row must be declared on its line with its
default; parameters that these files declare beside the table's are listed, and so are those without a literal default.
"""

import json
import os
import re
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from vastflow.sim.nav2.parameter_files.declared import declared_defaults

CALL = re.compile(
    r"\b(declare_parameter_if_not_declared|declare_parameter|declareParameter|declare_or_get_parameter|add_parameter"
    r"|searchAndGetParam|getParam)\s*(?:<[\w:<>, ]*>)?\("
)
NOT_CODE = re.compile(r'"(?:\\.|[^"\\])*"|//[^\n]*|/\*.*?\*/', re.DOTALL)
CONSTANTS = {
    "mode": "0",
    "source_timeout_.seconds()": "2.0",
    "MAX_NON_OBSTACLE": "252",
    "static_cast<unsigned char>(0xff)": "255",
}


def without_comments(text: str) -> str:
    return NOT_CODE.sub(lambda found: found[0] if found[0][0] == '"' else re.sub(r"[^\n]", " ", found[0]), text)


def arguments(text: str, at: int) -> list[str]:
    """The arguments of a call whose parenthesis opens before `at`, each on one line."""
    depth, start, found, quoted = 0, at, [], False
    for k in range(at, len(text)):
        quoted ^= text[k] == '"' and text[k - 1] != "\\"
        if quoted:
            continue
        if text[k] in ")]}" and depth == 0:
            return [" ".join(each.split()) for each in (*found, text[start:k])]
        depth += (text[k] in "([{") - (text[k] in ")]}")
        if text[k] == "," and depth == 0:
            found.append(text[start:k])
            start = k + 1
    raise ValueError("a call without end")


def literal(text: str, source: str) -> Any:
    """Value of a C++ literal; None for a type alone, which is no default.

    Raises:
        ValueError: it is an expression.
    """
    if found := re.fullmatch(r"(?:rclcpp::)?ParameterValue\((.*)\)|std::string\((.*)\)", text):
        return literal((found[1] or found[2]).strip(), source)
    if re.fullmatch(r"rclcpp::PARAMETER_\w+|rclcpp::ParameterType::\w+", text):
        return None
    if found := re.fullmatch(r"std::vector<[\w:]+>[({](.*)[)}]", text):
        return [literal(each.strip(), source) for each in found[1].split(",") if each.strip()]
    if re.fullmatch(r"default_\w+", text) and (found := re.search(rf"{text}\s*(?:=\s*)?\{{([^}}]*)\}}", source)):
        return json.loads(f"[{found[1]}]")
    if found := re.fullmatch(r"(-?[\d.]+(?:e-?\d+)?)f?(?: / ([\d.]+))?", CONSTANTS.get(text, text)):
        return float(found[1]) / float(found[2]) if found[2] else json.loads(found[1])
    return json.loads(text)  # text, true, or false


def declarations(file: Path) -> Iterator[tuple[int, str, str]]:
    """Line, name, and default of each parameter that a file declares; the last name where it is put together."""
    text = without_comments(file.read_text(encoding="utf-8"))
    for call in CALL.finditer(text):
        given = arguments(text, call.end())
        named = next((k for k, each in enumerate(given) if '"' in each), len(given))
        if named + 1 < len(given):
            name = re.findall(r'"([^"]*)"', given[named])[-1].lstrip(".")
            yield text.count("\n", 0, call.start()) + 1, name, given[named + 1]


def main(root: Path) -> int:
    table: dict[str, dict[tuple[int, str], Any]] = {}
    for group in declared_defaults().values():
        for name, (default, source) in group.items():
            file, _, line = source.rpartition(":")
            table.setdefault(file, {})[int(line), name] = default
    wrong, beside = [], []
    for file, rows in table.items():
        text = without_comments((root / file).read_text(encoding="utf-8"))
        found = {(line, name): default for line, name, default in declarations(root / file)}
        for (line, name), default in rows.items():
            try:
                here = literal(found[line, name], text)
                if repr(here) != repr(default):  # 20 and 20.0 are different parameters
                    wrong.append(f"{file}:{line}: {name}: Nav2 has {here!r}, the table {default!r}")
            except (KeyError, ValueError):
                wrong.append(f"{file}:{line}: {name}: the table has {default!r}, Nav2 {found.get((line, name))}")
        beside += [
            f"{file}:{line}: {name} = {text}" for (line, name), text in found.items() if (line, name) not in rows
        ]
    print(*wrong, *(f"not in the table: {each}" for each in beside), sep="\n")
    print(f"{sum(map(len, table.values()))} parameters in {len(table)} files, {len(wrong)} of them wrong")
    return 1 if wrong else 0


if __name__ == "__main__":
    given = sys.argv[1] if len(sys.argv) > 1 else os.environ.get("NAVIGATION2", "")
    if not Path(given, "nav2_amcl").is_dir() or not given:
        sys.exit(f"expected a checkout of Nav2's source, got {given!r}.\n{__doc__}")
    sys.exit(main(Path(given)))
