"""Mutants of every kind of file are accepted or refused: `tests/proofs/fuzz.py` in short."""

import sys
from pathlib import Path

import pytest

PROOFS = Path(__file__).parents[1] / "proofs"
MUTANTS = {
    "vast": 25,
    "osc": 40,
    "fpm": 40,
    "variation": 30,
    "map": 100,
    "picture": 150,
    "nav2": 40,
    "notebook": 150,
    "directory": 12,
}


@pytest.fixture(scope="module")
def fuzz():
    sys.path.insert(0, str(PROOFS))
    try:
        import fuzz

        yield fuzz
    finally:
        sys.path.remove(str(PROOFS))
        for name in ("fuzz", "fuzz_kinds", "fuzz_mutants"):
            sys.modules.pop(name, None)


@pytest.fixture(scope="module")
def folder(fuzz, tmp_path_factory):
    folder = tmp_path_factory.mktemp("fuzz")
    fuzz.laid_out(folder)
    return folder


@pytest.mark.slow
@pytest.mark.parametrize("name", MUTANTS)
def test_mutant_is_accepted_or_refused_with_its_file(fuzz, folder, monkeypatch, name):
    monkeypatch.setenv("VASTFLOW_STORE", str(folder / "store"))
    (kind,) = (kind for kind in fuzz.kinds(folder) if kind.name == name)
    count = fuzz.Count()
    for number, said, cpu_s in fuzz.read_here(kind, range(MUTANTS[name]), 1, folder):
        count.add(said if said in ("accepted", "refused") else f"{name} {number}: {said}", cpu_s)
    assert count.violations == []
    assert count.slowest_s < fuzz.MOST_CPU_S
    assert min(count.accepted, count.refused) > 0  # neither are all refused nor is all accepted


def test_fuzz_finds_files_neither_accepted_nor_refused(fuzz, folder):
    def read(file):
        raise (KeyError, MemoryError, SystemExit)[file.stat().st_size % 3]("key")

    (kind,) = (kind for kind in fuzz.kinds(folder) if kind.name == "map")
    broken = fuzz.replace(kind, read=read)
    assert all("Error" in said or "Exit" in said for _, said, _ in fuzz.read_here(broken, range(5), 1, folder))
    silent = fuzz.replace(kind, read=lambda file: (_ for _ in ()).throw(kind.refusals[0]("somewhere")))
    assert all("does not name the file" in said for _, said, _ in fuzz.read_here(silent, range(5), 1, folder))
