"""A campaign file named in eight ways: every way gives the same numbers, and only the first computes anything.

Each campaign is copied and run from the command line: by an absolute path, by relative ones from three folders, through links to
the file and to its folder. Prints a line for each way: runs executed and reused, passed, failed and not judged. Exit code 1 where
one differs from the first or computes a run; 2 where a campaign is not there.

    python tests/proofs/spellings.py [CAMPAIGN.vast ...]

Without campaigns: those of RoboVAST that start programs, `growth_sim` and `quadrotor_landing`, of `../shared/upstream`.
"""

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from pathlib import Path

UPSTREAM = Path(__file__).parents[3] / "shared" / "upstream" / "robovast-configs" / "examples"
USUAL = (UPSTREAM / "growth_sim" / "growth_sim.vast", UPSTREAM / "quadrotor_landing" / "quadrotor_landing.vast")


def spellings(file: Path, links: Path) -> dict[str, tuple[Path, Path]]:
    """Way to the working folder and the path of a campaign file that is named so."""
    base, name = file.parent, file.name
    (links / "link.vast").symlink_to(file)
    (links / "folder").symlink_to(base)
    return {
        "absolute": (links, file),
        "in its folder": (base, Path(name)),
        "from the folder above": (base.parent, Path(base.name, name)),
        "from elsewhere": (Path("/"), file.relative_to("/")),
        "up and down again": (base, Path("..", base.name, name)),
        "link to the file": (links, Path("link.vast")),
        "link to the folder": (links, Path("folder", name)),
        "link and up": (links, Path("folder", "..", base.name, name)),
    }


def counts(here: Path, file: Path, kept: Path) -> dict[str, int]:
    """Counts of one run of the campaign."""
    command = [sys.executable, "-m", "vastflow.flows.cli", "run", str(file), "--json"]
    options = ["--store", str(kept / "store"), "--results", str(kept / "results")]
    done = subprocess.run([*command, *options], cwd=here, capture_output=True, text=True, check=False)
    if done.returncode not in (0, 3):
        raise SystemExit(done.stderr)
    said = json.loads(done.stdout)
    return {key: said[key] for key in ("executed", "reused", "passed", "failed", "not_judged")}


def is_proven(campaign: Path) -> bool:
    """Print what each way of naming it counts; whether all agree and nothing is computed twice."""
    with tempfile.TemporaryDirectory(prefix="vastflow-spellings-") as folder:
        place = Path(folder).resolve()
        shutil.copytree(campaign.parent, place / "campaign")
        (place / "links").mkdir()
        first: dict[str, int] | None = None
        agrees = True
        print(campaign.stem)
        for way, (here, file) in spellings(place / "campaign" / campaign.name, place / "links").items():
            found = counts(here, file, place)
            numbers = {key: found[key] for key in ("passed", "failed", "not_judged")}
            if first is None:
                first = numbers
            elif numbers != first or found["executed"]:
                agrees = False
            print(f"  {way:22} " + "  ".join(f"{key} {value}" for key, value in found.items()), flush=True)
    return agrees


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("campaigns", nargs="*", type=Path)
    asked = parser.parse_args().campaigns or USUAL
    for missing in (each for each in asked if not each.is_file()):
        print(f"{missing}: no such file", file=sys.stderr)
        raise SystemExit(2)
    results = [is_proven(each.resolve()) for each in asked]
    raise SystemExit(0 if all(results) else 1)
