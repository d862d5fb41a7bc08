"""`vastflow publish` and `vastflow verify`: equal bytes, what is found wrong, and archives of strangers."""

import contextlib
import hashlib
import io
import json
import os
import pty
import shutil
import sys
import zipfile
from pathlib import Path

import bagit
import pytest
from command_line import called, refused
from room import SMALL_ROOM, drawn_room
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.publication.about import orcid_of
from vastflow.flows.publication.verification import undetected_share
from vastflow.flows.results import trust
from vastflow.flows.results.trust import ForeignCode, NotPermitted
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.oracles.observation.observe import observe_block
from vastflow.oracles.replay import recorded as replayed
from vastflow.sim.model.archive import write_behaviors
from vastflow.sim.model.blocks import read_recordings, write_recordings
from vastflow.sim.model.faults import UserError
from vastflow.sim.run import run
from vastflow.tasks.keys.source import installed_tree

AUTHOR = ("--license", "CC-BY-4.0", "--author", "Doe, Jane; 0000-0002-1825-0097; Some University")
CAMPAIGN = SMALL_ROOM.replace("0.02]", "0.02, 0.0]").replace("x: 3.0", "x: 4.5") + "  seed: 5\n  timeout: 3\n"


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    """Two configurations and a duplicate of one, with two runs of three seconds each."""
    folder = tmp_path_factory.mktemp("campaign")
    drawn_room(folder)
    (folder / "room.vast").write_text(CAMPAIGN)

    def found(configuration):
        recordings = [run(configuration.scenario, k, 5) for k in range(2)]
        block = write_recordings(recordings)
        behaviors = write_behaviors({each.run.run_index: each.behaviors for each in recordings})
        verdicts = [Verdict("success", k, "fail") for k in range(2)]
        traces = [observe_block(configuration.scenario, block)]
        return ConfigurationResult([block], traces, verdicts, behaviors=[behaviors])

    return write_results(folder / "room.vast", folder / "results", found, tree=installed_tree()).directory


@pytest.fixture(scope="module")
def archive(results, tmp_path_factory):
    file = tmp_path_factory.mktemp("published") / "room.zip"
    done = called("publish", results, file, *AUTHOR)
    assert done.exit_code == 0, done.output
    return file


def rewritten(archive, file, change):
    """Write an archive with its files changed by `change`, which takes a dictionary of their contents."""
    with zipfile.ZipFile(archive) as source:
        top = source.namelist()[0].partition("/")[0]
        contents = {name.partition("/")[2]: source.read(name) for name in source.namelist()}
    change(contents)
    with zipfile.ZipFile(file, "w") as target:
        for name, content in contents.items():
            target.writestr(f"{top}/{name}", content)
    return file


def flipped(content):
    return content[:-1] + bytes([content[-1] ^ 1])


def test_publication_has_equal_bytes_twice(results, archive, tmp_path):
    called("publish", results, tmp_path / "again.zip", *AUTHOR)
    assert (tmp_path / "again.zip").read_bytes() == archive.read_bytes()


def test_publication_is_a_bag_to_another_program(archive, tmp_path):
    shutil.unpack_archive(archive, tmp_path)
    (folder,) = tmp_path.iterdir()
    assert bagit.Bag(str(folder)).validate()


def test_crate_has_required_entities_of_specification(archive):
    with zipfile.ZipFile(archive) as source:
        names = {name.partition("/data/")[2] for name in source.namelist()}
        crate = json.loads(source.read(next(n for n in source.namelist() if n.endswith("ro-crate-metadata.json"))))
    entities = {each["@id"]: each for each in crate["@graph"]}
    assert len(entities) == len(crate["@graph"])
    assert crate["@context"][0] == "https://w3id.org/ro/crate/1.2/context"
    descriptor, root = entities["ro-crate-metadata.json"], entities["./"]
    assert (descriptor["@type"], descriptor["about"]) == ("CreativeWork", {"@id": "./"})
    assert descriptor["conformsTo"] == {"@id": "https://w3id.org/ro/crate/1.2"}
    assert root["@type"] == "Dataset" and all(root[key] for key in ("name", "description", "datePublished", "license"))
    assert {"name", "description"} <= entities[root["license"]["@id"]].keys()
    assert root["conformsTo"] == {"@id": "https://w3id.org/ro/wfrun/process/0.5"}
    assert "Profile" in entities[root["conformsTo"]["@id"]]["@type"]
    action = entities[root["mentions"]["@id"]]
    assert action["@type"] == "CreateAction" and action["object"] and action["result"] and action["endTime"]
    assert entities[action["instrument"]["@id"]]["@type"] == "SoftwareApplication"
    assert entities[action["instrument"]["@id"]].keys() >= {"name", "version"}
    texts = json.dumps(crate["@graph"])
    referenced = {each.split('"')[0] for each in texts.split('{"@id": "')[1:]}
    assert {each for each in referenced - entities.keys() if "://" not in each} == set()
    files = [each["@id"] for each in entities.values() if each["@type"] == "File"]
    assert files and {*files} <= names


def test_provenance_leads_another_reader_from_verdicts_to_campaign_file(archive):
    """Walk from the verdicts to what they follow from, as the library `prov` reads it."""
    model = pytest.importorskip("prov.model")
    with zipfile.ZipFile(archive) as source:
        names = source.namelist()
        text, content = (
            source.read(next(name for name in names if name.endswith(end))) for end in ("prov.json", "verdicts.parquet")
        )
    document = model.ProvDocument.deserialize(content=text.decode(), format="json")
    origins = {}
    for kind in (model.ProvGeneration, model.ProvUsage, model.ProvDerivation):
        for each in document.get_records(kind):
            later, earlier = (str(value) for _, value in each.formal_attributes[:2])
            origins.setdefault(later, set()).add(earlier)
    chain, paths = [], {"file:verdicts.parquet": None}
    for node in (queue := ["file:verdicts.parquet"]):
        for earlier in sorted(origins.get(node, set()) - paths.keys()):
            paths[earlier] = node
            queue.append(earlier)
    node = "file:campaign.vast"
    while node is not None:
        chain.append(node)
        node = paths[node]
    assert [each.partition("/")[0] for each in chain[::-1]] == [
        "file:verdicts.parquet",
        "activity:judge",
        "file:traces",
        "activity:observe",
        "file:recordings",
        "activity:execute",
        "configuration:room-1",
        "file:campaign.vast",
    ]
    (verdicts,) = document.get_record("file:verdicts.parquet")
    assert verdicts.get_attribute("vastflow:sha256") == {hashlib.sha256(content).hexdigest()}


def test_verification_executes_all_runs_again(archive):
    done = called("verify", archive, "--runs", "all")
    assert done.exit_code == 0, done.output
    assert "4 of 4 runs executed again: 4 equal bit for bit" in done.stdout


def change_data(contents):
    name = "data/campaign/metadata.json"
    contents[name] = flipped(contents[name])


def change_manifest(contents):
    contents["manifest-sha256.txt"] = contents["manifest-sha256.txt"].replace(b"a", b"b", 1)


def change_provenance(contents):
    contents["data/prov.json"] = contents["data/prov.json"].replace(b"vastflow:bytes", b"vastflow:octets", 1)


@each_row(
    ("change", "words"),
    [
        (change_data, "differs: data/campaign/metadata.json"),
        (change_manifest, "differs: manifest-sha256.txt"),
        (change_provenance, "differs: data/prov.json"),
        (lambda contents: contents.pop("data/campaign/runs.parquet"), "missing: data/campaign/runs.parquet"),
        (lambda contents: contents.update({"data/more\x1b[2J": b"x"}), "extra: data/more\\x1b[2J"),
    ],
)
def test_verification_names_each_wrong_file(archive, tmp_path, change, words):
    done = called("verify", rewritten(archive, tmp_path / "wrong.zip", change), "--runs", "0")
    assert (done.exit_code, words in done.stdout) == (1, True), done.output


@each_row(
    ("place", "old", "words"),
    [
        ("ro-crate-metadata.json", b'"sha256": "', "not as ro-crate-metadata.json has it: data/"),
        ("prov.json", b'"vastflow:sha256": "', "not as prov.json has it: data/campaign/"),
        ("prov.json", b'"entity', "no description of files: data/prov.json"),
    ],
)
def test_verification_compares_descriptions_with_files_too(archive, tmp_path, place, old, words):
    def describe(contents):
        name = f"data/{place}"
        begin = contents[name].rindex(old) + len(old)
        new = b"0" * 64 if old.endswith(b': "') else b"s"
        replace_digest(contents, name, contents[name][:begin] + new + contents[name][begin + len(new) :])

    done = called("verify", rewritten(archive, tmp_path / "wrong.zip", describe), "--runs", "0")
    assert (done.exit_code, words in done.stdout) == (1, True), done.output


def forge(contents):
    """Change one value of a recording, and every list of digests with it."""
    name = next(each for each in contents if "/recordings/" in each)
    recordings = read_of(contents[name])
    key = next(iter(recordings[1].columns))
    recordings[1].columns[key][-1] += 1
    new = write_recordings(recordings)
    replace_digest(contents, name, new)


def read_of(content):
    file = Path("/dev/shm") / hashlib.sha256(content).hexdigest()
    file.write_bytes(content)
    try:
        return [*read_recordings(file)]
    finally:
        file.unlink()


def replace_digest(contents, name, new):
    """Write a file, then the lists that have its digest, then the lists of those."""
    before, contents[name] = hashlib.sha256(contents[name]).hexdigest(), new
    after = hashlib.sha256(new).hexdigest()
    for listing in [each for each in contents if before.encode() in contents[each]]:
        replace_digest(contents, listing, contents[listing].replace(before.encode(), after.encode()))


def test_verification_finds_forged_recording_by_execution(archive, tmp_path):
    forged = rewritten(archive, tmp_path / "forged.zip", forge)
    digests = called("verify", forged, "--runs", "0")
    assert digests.exit_code == 0, digests.output
    done = called("verify", forged, "--runs", "all")
    assert done.exit_code == 1 and "different: " in done.stdout and "3 equal bit for bit, 1 different" in done.stdout


def zipped(*names, mode=0o100644, content=b"x"):
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w", zipfile.ZIP_DEFLATED) as written:
        for name in names:
            entry = zipfile.ZipInfo(name)
            entry.external_attr, entry.compress_type = mode << 16, zipfile.ZIP_DEFLATED
            written.writestr(entry, content)
    return out.getvalue()


@pytest.mark.filterwarnings("ignore:Duplicate name")
@each_row(
    ("content", "words"),
    [
        (b"no archive", "expected an archive of `vastflow publish`: File is not a zip"),
        (zipped("/etc/x"), "is no path inside the folder"),
        (zipped("top/../../x"), "is no path inside the folder"),
        (zipped("top/link", mode=0o120777), "is a link"),
        (zipped("top/a", "top/a"), "twice"),
        (zipped("top/a", "top/a/b"), "'a/b' lies below a file"),
        (zipped("a/b", "c/d"), "it has 2 folders in place of one"),
        (zipped("top/bomb", content=bytes(200_000_000)), "a zip bomb"),
        (zipped("top/a"), "a bag without manifest-sha256.txt"),
        (zipped("top/manifest-sha256.txt", content=b"nonsense"), "a SHA-256 and a file"),
    ],
)
def test_verification_refuses_archive_of_stranger_in_one_sentence(tmp_path, content, words):
    (file := tmp_path / "a.zip").write_bytes(content)
    assert words in refused("verify", file)


def with_input(results, folder, name, content):
    copy = folder / "copy"
    shutil.copytree(results, copy)
    (copy / "inputs" / name).write_bytes(content)
    return copy


def test_verification_asks_for_code_of_the_archive_by_its_name(archive, monkeypatch):
    def refuse(directory, consent):
        raise NotPermitted(ForeignCode(str(directory), ("inputs/own.py",), "d" * 64))

    monkeypatch.setattr(trust, "permitted_contents", refuse)
    monkeypatch.setattr(replayed, "needs_code", lambda recorded: True)
    done = called("verify", archive, "--runs", "1")
    assert done.exit_code == 2
    words = f"{archive} would execute code that you neither made nor permitted: inputs/own.py (digest dddddddddddd). Permit it by --trust."
    assert done.stderr.splitlines()[-1] == words


def test_opaque_input_blocks_before_anything_is_written(results, tmp_path):
    copy = with_input(results, tmp_path, "solver", b"\x7fELF\0\0")
    done = called("publish", copy, tmp_path / "a.zip", *AUTHOR)
    assert done.exit_code == 2 and "solver (a binary file of unknown kind)" in done.stderr
    assert not (tmp_path / "a.zip").exists()
    assert called("publish", copy, tmp_path / "a.zip", *AUTHOR, "--allow-opaque", "solver").exit_code == 0


def test_private_map_is_left_out_with_its_environment(results, tmp_path):
    done = called("publish", results, tmp_path / "a.zip", *AUTHOR, "--private", "room.pgm")
    assert done.exit_code == 0, done.output
    with zipfile.ZipFile(tmp_path / "a.zip") as source:
        names = source.namelist()
        card = source.read(next(name for name in names if name.endswith("data/README.md"))).decode()
    assert not [name for name in names if name.endswith(".pgm") or "/environments/" in name]
    assert "- `inputs/room.pgm`: private" in card
    assert "| `campaign/runs.parquet` | A row for each run" in card and "`campaign/environments/`" not in card


def test_parts_are_left_out_and_shown_with_sizes(results, tmp_path):
    done = called("publish", results, tmp_path / "a.zip", *AUTHOR, "--without", "recordings", "--dry-run")
    assert "left out: recordings (by choice)" in done.stdout and not (tmp_path / "a.zip").exists()
    assert "no part 'traces,' can be left out" not in done.output
    assert "'recording'" in refused_after("publish", results, tmp_path / "a.zip", "--without", "recording")


def refused_after(*arguments):
    done = called(*arguments)
    assert done.exit_code == 2
    return done.stderr


@each_row(
    ("options", "words"),
    [
        ((), "no license"),
        (("--license", "CC-BY-4.0"), "no author"),
        (("--license", "Free-for-all", "--author", "Doe, Jane"), "expected SPDX"),
        (("--license", "MIT", "--author", "Doe, Jane; 0000-0002-1825-0098"), "check digit 7"),
    ],
)
def test_publication_names_missing_or_wrong_description(results, tmp_path, options, words):
    assert words in refused_after("publish", results, tmp_path / "a.zip", *options)


def test_publication_asks_on_a_terminal_for_license_and_author(results, tmp_path):
    """Type the answers into a real pseudo-terminal, as a user would."""
    command = [sys.executable, "-m", "vastflow.flows.cli", "publish", str(results), str(tmp_path / "a.zip")]
    pid, terminal = pty.fork()
    if pid == 0:
        os.execv(sys.executable, command)
    shown = b""
    for question, answer in ((b"License", b"CC-BY-4.0\n"), (b"Author", "Doe, Jörg; 0000-0002-1825-0097\n".encode())):
        while question not in shown.rpartition(b"\n")[2]:
            shown += os.read(terminal, 4096)
        os.write(terminal, answer)
    with contextlib.suppress(OSError):  # Linux's end of a terminal
        while part := os.read(terminal, 4096):
            shown += part
    os.close(terminal)
    assert os.waitstatus_to_exitcode(os.waitpid(pid, 0)[1]) == 0, shown
    with zipfile.ZipFile(tmp_path / "a.zip") as source:
        card = source.read(next(name for name in source.namelist() if name.endswith("data/README.md"))).decode()
    assert "- Doe, Jörg (https://orcid.org/0000-0002-1825-0097)" in card and "- License: CC-BY-4.0" in card


def test_orcid_has_check_digit_x():
    assert orcid_of("https://orcid.org/0000-0002-1694-233x", "here") == "0000-0002-1694-233X"
    with pytest.raises(UserError, match="check digit X"):
        orcid_of("0000-0002-1694-2331", "here")


def test_undetected_share_is_that_of_the_hypergeometric_distribution():
    from scipy.stats import hypergeom

    for drawn, of in ((10, 222), (3, 20), (59, 100_000)):
        wrong = round(undetected_share(drawn, of) * of)
        assert hypergeom.pmf(0, of, wrong, drawn) >= 0.05 > hypergeom.pmf(0, of, wrong + 1, drawn)
    assert undetected_share(20, 20) == 0.0
