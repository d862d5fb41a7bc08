"""Check that this checkout's wheel is complete, runs a campaign, and has the checkout's keys.

`installed.py` goes further: it installs the wheel with all that it needs, and runs the campaign. Prints what is wrong; exit code 1
when something is.

    python tests/proofs/wheel.py
"""

import os
import subprocess
import sys
import tempfile
import zipfile
from pathlib import Path

import installed

ROOT = Path(__file__).parents[2]
LAYERS = ("deployments", "flows", "oracles", "producers", "sim", "tasks")
DATA = (
    *(f"vastflow/{name}.py" for name in ("__init__", "plugins", "surface")),
    "vastflow/py.typed",
    "vastflow/sim/scenario/language/grammar.lark",
    "vastflow/sim/scenario/language/library/nav2.osc",
    *(f"vastflow/oracles/page/report.{kind}" for kind in ("html.j2", "css", "js")),
    "vastflow/oracles/page/call.html.j2",
)
KEYS = """
from importlib.metadata import entry_points

import vastflow
from vastflow.tasks.keys.keys import EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE
from vastflow.tasks.keys.source import installed_tree

tree = installed_tree()
print(vastflow.__file__)
for entries in (EVALUATE_SOURCE, EXECUTE_SOURCE, JUDGE_SOURCE, OBSERVE_SOURCE):
    print(*entries, tree.digest(*entries))
for group in ("vastflow.producers", "vastflow.oracles"):
    for point in sorted(entry_points(group=group)):
        print(point.name, tree.plug_in_digest(point.load()))
"""


def main() -> int:
    with tempfile.TemporaryDirectory(prefix="vastflow-wheel-") as folder:
        wheel = installed.built(Path(folder, "source"))
        site = Path(folder, "site")
        zipfile.ZipFile(wheel).extractall(site)
        wrong = wrong_names(zipfile.ZipFile(wheel).namelist())
        wrong += wrong_campaign(site, Path(folder, "first"))
        wrong += wrong_keys(site, Path(folder, "cache"))
    for problem in wrong:
        print(f"wheel: {problem}", file=sys.stderr)
    if not wrong:
        print(f"{wheel.name}: complete")
    return bool(wrong)


def wrong_names(names: list[str]) -> list[str]:
    """Problems of what the wheel holds."""
    packages = [init.parent for layer in LAYERS for init in (ROOT / layer).rglob("__init__.py")]
    needed = {file for folder in packages for file in folder.iterdir() if file.suffix in (".py", ".j2", ".typed")}
    kinds = ("pools/*.json", "templates/*.yaml", "explorer/static/*", "explorer/templates/*.j2")
    needed |= {file for kind in kinds for file in (ROOT / "deployments").glob(kind)}
    campaigns = {
        *(ROOT / "campaigns" / "benchmark").iterdir(),
        *(ROOT / "campaigns" / "scenarios").glob("*.osc"),
        *(ROOT / "campaigns" / "scenarios").glob("hall.*"),
        ROOT / "campaigns" / "quickstart" / "quickstart.vast",
        *(ROOT / "campaigns" / "quickstart" / "maps").glob("office.*"),
    }
    expected = {f"vastflow/{file.relative_to(ROOT).as_posix()}" for file in needed | campaigns} | {*DATA}
    shipped = {name for name in names if name.startswith("vastflow/campaigns/")}
    extra = {*(name for name in names if name.partition("/")[0] != "vastflow" and ".dist-info/" not in name)}
    extra |= shipped - expected
    problems = [f"expected {name}, got nothing" for name in sorted(expected - {*names})]
    problems += [f"expected no {name}" for name in sorted(extra)]
    if not any(name.endswith(".dist-info/licenses/docs/LICENSE") for name in names):
        problems.append("expected the license, got nothing")
    return problems


def run(site: Path, cache: Path, *arguments: object) -> subprocess.CompletedProcess[str]:
    """A call of Python that finds the package in `site` first, in a folder where nothing else of it lies."""
    environment = {**os.environ, "PYTHONPATH": str(site), "XDG_CACHE_HOME": str(cache)}
    command = [sys.executable, *map(str, arguments)]
    return subprocess.run(command, cwd=site.parent, env=environment, capture_output=True, text=True, check=False)


def wrong_campaign(site: Path, first: Path) -> list[str]:
    """Problems of the campaign that `vastflow init` writes."""
    for arguments in (("init", first), ("validate", first / "quickstart.vast")):
        called = run(site, first.with_name("cache"), "-m", "vastflow.flows.cli", *arguments)
        if called.returncode:
            return [f"vastflow {arguments[0]}: {called.stdout}{called.stderr}"]
    return []


def wrong_keys(site: Path, cache: Path) -> list[str]:
    """Problems of the keys that what is installed has."""
    ours, theirs = run(ROOT / ".package", cache, "-c", KEYS), run(site, cache, "-c", KEYS)
    if ours.returncode or theirs.returncode:
        return [f"keys: {ours.stderr}{theirs.stderr}"]
    (_, *expected), (file, *got) = ours.stdout.splitlines(), theirs.stdout.splitlines()
    if not file.startswith(str(site)):
        return [f"expected the package in {site}, got {file}"]
    return [
        f"expected the key {one}, got {other}" for one, other in zip(expected, got, strict=True) if one != other
    ] or ([] if len(got) > 4 else ["expected more than 4 keys"])


if __name__ == "__main__":
    sys.exit(main())
