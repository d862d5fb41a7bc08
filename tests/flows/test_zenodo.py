"""`vastflow publish --zenodo`: a draft with a DOI and the archive, at a strict server."""

import contextlib
import hashlib
import time

import httpx
import pytest
from command_line import called, refused
from invenio import LICENSES, MOST_BYTES, TOKEN, UNSCOPED, served
from room import SMALL_ROOM, drawn_room
from table import each_row
from whole_directory import ConfigurationResult, write_results

from vastflow.flows.publication import zenodo
from vastflow.flows.publication.about import About, Author
from vastflow.flows.publication.zenodo import Deposit
from vastflow.oracles.judgment.verdict import Verdict
from vastflow.sim.model.faults import UserError
from vastflow.tasks.keys.source import installed_tree

AUTHOR = ("--license", "CC-BY-4.0", "--author", "Doe, Jane; 0000-0002-1825-0097; Some University")
ABOUT = About("Rooms", "A <b> & c.\nMore.", "CC-BY-4.0", [Author("Doe, Jane")], ["robots", ""], "2026-01-31")


@pytest.fixture
def server():
    with served() as repository:
        yield repository


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("campaign")
    drawn_room(folder)
    (folder / "room.vast").write_text(SMALL_ROOM)
    found = ConfigurationResult([], [], [Verdict("success", 0, "pass")])
    return write_results(folder / "room.vast", folder / "out", lambda _: found, tree=installed_tree()).directory


@pytest.fixture
def archive(tmp_path):
    (file := tmp_path / "a b.zip").write_bytes(b"content" * 1000)
    return file


def published(results, archive, address, token=TOKEN, *options):
    return called("publish", results, archive, *AUTHOR, "--zenodo-at", address, *options, ZENODO_ACCESS_TOKEN=token)


def test_draft_has_description_doi_and_archive_and_is_not_published(results, tmp_path, server):
    done = published(results, file := tmp_path / "room.zip", server.url)
    assert done.exit_code == 0, done.output
    assert done.stdout.splitlines()[-2:] == [
        f"draft: {server.url}/uploads/d1-x, DOI 10.5281/zenodo.d1-x",
        f"uploaded: {file}. Nothing is published: Publish the draft there, or discard it.",
    ]
    draft = server.drafts["d1-x"]
    assert draft["files"] == {"room.zip": file.read_bytes()}
    assert draft["pids"]["doi"]["identifier"] == "10.5281/zenodo.d1-x"
    creator = {"type": "personal", "family_name": "Doe", "given_name": "Jane"}
    orcid = [{"scheme": "orcid", "identifier": "0000-0002-1825-0097"}]
    assert draft["metadata"] | {"description": ""} == {
        "resource_type": {"id": "dataset"},
        "title": "small_room",
        "publication_date": draft["metadata"]["publication_date"],
        "creators": [
            {"person_or_org": {**creator, "identifiers": orcid}, "affiliations": [{"name": "Some University"}]}
        ],
        "publisher": "127.0.0.1",
        "description": "",
        "rights": [{"id": "cc-by-4.0"}],
        "subjects": [],
    }
    assert not [each for each in server.asked if "publish" in each]
    lengths = [
        each["Content-Length"] for each in server.headers if each.get("Content-Type") == "application/octet-stream"
    ]
    assert lengths == [str(file.stat().st_size)]


def test_description_is_escaped_and_names_organizations_and_license_expressions():
    about = About(
        "T", ABOUT.description, "MIT OR Apache-2.0", [Author("Some Institute")], ["a"], "2026-01-31", "2", "P"
    )
    metadata = zenodo.metadata_of(about, "zenodo.org")
    assert metadata["description"] == "<p>A &lt;b&gt; &amp; c.<br>More.</p>"
    assert metadata["creators"][0]["person_or_org"] == {
        "type": "organizational",
        "name": "Some Institute",
        "identifiers": [],
    }
    assert metadata["rights"] == [{"title": {"en": "MIT OR Apache-2.0"}}]
    assert (metadata["subjects"], metadata["version"], metadata["publisher"]) == ([{"subject": "a"}], "2", "P")
    assert zenodo.metadata_of(ABOUT, "sandbox.zenodo.org")["publisher"] == "Zenodo"


def test_described_draft_keeps_doi_and_additions_by_hand(server, archive):
    first = Deposit(server.url, TOKEN)
    doi, _ = first.describe(ABOUT)
    first.upload(archive)
    server.drafts["d1-x"]["metadata"]["languages"] = [{"id": "eng"}]
    again = Deposit(first.address, TOKEN)
    later = again.describe(About("Other", "D", "MIT", [Author("Doe, Jane")], [], "2026-01-31"))
    archive.write_bytes(b"other")
    again.upload(archive)
    assert later == (doi, [])
    assert server.drafts["d1-x"]["pids"]["doi"]["identifier"] == doi
    assert server.drafts["d1-x"]["metadata"]["title"] == "Other"
    assert server.drafts["d1-x"]["metadata"]["languages"] == [{"id": "eng"}]
    assert server.drafts["d1-x"]["files"] == {"a b.zip": b"other"}


def test_failed_upload_says_what_is_left_and_goes_on_when_repeated(results, tmp_path, server):
    server.instead["PUT .*content"] = [(503, {}, {"message": "Later"})]
    file = tmp_path / "room.zip"
    failed = published(results, file, server.url)
    address = f"{server.url}/uploads/d1-x"
    assert failed.exit_code == 2
    (line,) = failed.stderr.splitlines()
    assert line == (
        f"{server.url}: PUT /api/records/d1-x/draft/files/room.zip/content was answered by 503: Later. "
        f"{file} stays, but is not uploaded: Repeat the command with --zenodo-at {address}."
    )
    before = file.read_bytes()
    done = published(results, file, address)
    assert done.exit_code == 0, done.output
    assert file.read_bytes() == before and [*server.drafts] == ["d1-x"]
    assert server.drafts["d1-x"]["files"] == {"room.zip": before}


def test_publication_keeps_existing_archive_of_other_results(results, tmp_path, server):
    (file := tmp_path / "room.zip").write_bytes(b"mine")
    done = published(results, file, server.url)
    assert done.exit_code == 2 and "expected a new file, or the archive of these results" in done.stderr
    assert file.read_bytes() == b"mine" and server.asked == [] and [*tmp_path.iterdir()] == [file]


@each_row(
    ("token", "words"),
    [
        ("", "ZENODO_ACCESS_TOKEN: expected a token of"),
        ("two\nlines", "ZENODO_ACCESS_TOKEN: expected a token of"),
        ("wrong", "answered by 401: expected a token of this server in ZENODO_ACCESS_TOKEN"),
        (UNSCOPED, "answered by 403: expected a token with the scope deposit:write"),
    ],
)
def test_missing_and_refused_tokens_are_named_and_never_shown(results, tmp_path, server, token, words):
    done = published(results, tmp_path / "room.zip", server.url, token)
    assert done.exit_code == 2 and words in done.stderr.splitlines()[-1], done.output
    assert not token.strip() or token not in done.output
    assert "tokens" if token else not (tmp_path / "room.zip").exists()


@each_row(
    ("address", "is_right"),
    [
        ("https://sandbox.zenodo.org", True),
        ("https://sandbox.zenodo.org/uploads/123/", True),
        ("http://localhost:5000", True),
        ("http://[::1]:5000", True),
        ("http://zenodo.org", False),
        ("http://127.0.0.1.example.org", False),
        ("https://jane:password@zenodo.org", False),
        ("https://zenodo.org/uploads/../x", False),
        ("zenodo.org", False),
    ],
)
def test_addresses_are_encrypted_or_of_this_machine(address, is_right):
    if is_right:
        Deposit(address, TOKEN)
    else:
        with pytest.raises(UserError, match="expected an address such as") as refusal:
            Deposit(address, TOKEN)
        assert "password" not in str(refusal.value)


@each_row(
    ("answer", "words"),
    [
        (
            (400, {}, {"message": "No.", "errors": [{"field": "title", "messages": ["Too short"]}]}),
            "400: title: Too short, No.",
        ),
        ((500, {}, b"<html>"), "500: no reason"),
        ((413, {}, b""), "413: expected a smaller file"),
        ((415, {}, {"message": "No JSON."}), "415: No JSON."),
        ((201, {}, b"<html>"), "201: expected a JSON object"),
        ((201, {}, b"[1]"), "201: expected a JSON object"),
        ((201, {}, b'{"id": "../x"}'), "expected the id of a draft, got '../x'"),
        ((201, {}, b"[" * 100_000), "201: expected a JSON object"),
        ((201, {}, b"1" * 20_000_000), "expected an answer of at most"),
        ((400, {}, {"message": f"Token {TOKEN} is odd.", "errors": [1, {"messages": 2}]}), "Token … is odd."),
        ((400, {}, {"message": "\x1b[2J\nGone."}), "400: [2J Gone."),
        ((302, {"Location": "http://localhost:1/"}, b""), "302: expected no redirect, which is not followed"),
        ((429, {"Retry-After": "10000"}, b""), "429: it asks to wait 10000 s"),
        ((429, {"X-RateLimit-Reset": "inf"}, b""), "429: it asks to wait inf s"),
    ],
)
def test_refusals_and_odd_answers_are_one_sentence(server, answer, words):
    server.instead["POST /api/records"] = [answer]
    with pytest.raises(UserError) as refusal:
        Deposit(server.url, TOKEN).describe(ABOUT)
    assert words in str(refusal.value) and "\n" not in str(refusal.value) and TOKEN not in str(refusal.value)


def test_token_does_not_follow_redirects_to_another_host(server):
    with served() as other:
        server.instead["POST /api/records"] = [(307, {"Location": f"{other.url}/api/records"}, b"")]
        with pytest.raises(UserError, match="answered by 307"):
            Deposit(server.url, TOKEN).describe(ABOUT)
        assert other.asked == []


def test_server_that_asks_to_wait_is_asked_again_after_that_time(server, archive, monkeypatch):
    waited = []
    monkeypatch.setattr(time, "sleep", waited.append)
    server.instead["PUT .*content"] = [(429, {"Retry-After": "2"}, b""), (429, {}, b"")]
    server.instead["POST /api/records"] = [(429, {"X-RateLimit-Reset": str(time.time() + 50)}, b"")]
    deposit = Deposit(server.url, TOKEN)
    deposit.describe(ABOUT)
    deposit.upload(archive)
    assert 45 < waited[0] < 50 and waited[1:] == [2.0, 1.0]
    assert server.drafts["d1-x"]["files"] == {"a b.zip": archive.read_bytes()}


def test_server_that_always_asks_to_wait_is_given_up(server, monkeypatch):
    waited = []
    monkeypatch.setattr(time, "sleep", waited.append)
    server.instead["POST /api/records"] = [(429, {"Retry-After": "70"}, b"")] * 9
    with pytest.raises(UserError, match="429: it asks to wait 70 s"):
        Deposit(server.url, TOKEN).describe(ABOUT)
    assert sum(waited) <= zenodo.MOST_WAIT_S


def test_silent_refusing_and_unencrypted_servers_are_named(server, monkeypatch):
    monkeypatch.setattr(zenodo, "SILENT_S", 0.3)
    server.instead["POST /api/records"] = [None]
    with pytest.raises(UserError, match="no answer in 0 s"):
        Deposit(server.url, TOKEN).describe(ABOUT)
    with pytest.raises(UserError, match=r"127.0.0.1:1: no answer: .*refused"):
        Deposit("http://127.0.0.1:1", TOKEN).describe(ABOUT)
    with pytest.raises(UserError, match=r"no answer: .*SSL"):
        Deposit(server.url.replace("http:", "https:"), TOKEN).describe(ABOUT)
    for odd in ("http://127.0.0.1:99999", "https://a..b"):
        with pytest.raises(UserError, match="no answer: "):
            Deposit(odd, TOKEN).describe(ABOUT)


@each_row(
    ("there", "words"),
    [
        ({"checksum": "md5:0", "size": 7000}, "expected md5:"),
        ({"checksum": f"md5:{hashlib.md5(b'content' * 1000).hexdigest()}", "size": 6999}, "got 'md5:"),
        ({}, "of 7000 bytes, got None of None"),
    ],
)
def test_upload_that_arrives_otherwise_is_found(server, archive, there, words):
    server.instead["POST .*commit"] = [(200, {}, there)]
    deposit = Deposit(server.url, TOKEN)
    deposit.describe(ABOUT)
    with pytest.raises(UserError, match="expected md5:") as refusal:
        deposit.upload(archive)
    assert words in str(refusal.value)


def test_too_large_archive_and_unknown_license_are_named(server, archive):
    deposit = Deposit(server.url, TOKEN)
    assert "MIT-0".lower() not in LICENSES
    about = About("Rooms", "D", "MIT-0", [Author("Doe, Jane")], [], "2026-01-31")
    assert deposit.describe(about)[1] == ["metadata.rights.0: Invalid value mit-0."]
    archive.write_bytes(bytes(MOST_BYTES + 1))
    with pytest.raises(UserError, match="413: expected a smaller file"):
        deposit.upload(archive)


def test_deep_description_of_draft_is_no_traceback(server):
    server.drafts["d1-x"] = {"pids": {}, "metadata": {}, "files": {}}
    for levels in (50, 300, 600, 900, 980):
        server.instead["GET .*draft"] = [(200, {}, b'{"metadata": {"x": %s}}' % (b"[" * levels + b"]" * levels))]
        with contextlib.suppress(UserError):
            Deposit(f"{server.url}/uploads/d1-x", TOKEN).describe(ABOUT)


def test_draft_of_somebody_else_is_not_found(server):
    with pytest.raises(UserError, match="404: expected a draft of your own"):
        Deposit(f"{server.url}/uploads/other", TOKEN).describe(ABOUT)


def test_archive_has_no_token(results, tmp_path, server):
    file = tmp_path / "room.zip"
    assert published(results, file, server.url).exit_code == 0
    assert called("publish", results, tmp_path / "plain.zip", *AUTHOR).exit_code == 0
    assert (tmp_path / "plain.zip").read_bytes() == file.read_bytes()


def test_dry_run_asks_no_server(results, tmp_path, server):
    assert published(results, tmp_path / "a.zip", server.url, TOKEN, "--dry-run").exit_code == 0
    assert server.asked == []


def test_refused_before_anything_is_written(results, tmp_path):
    words = refused("publish", results, tmp_path / "a.zip", *AUTHOR, "--zenodo")
    assert "ZENODO_ACCESS_TOKEN" in words and not (tmp_path / "a.zip").exists()


def test_stub_refuses_what_the_real_server_refuses(server):
    """Drive the server by plain requests, so that the tests above mean something."""

    def ask(method, path, token=TOKEN, **sent):
        answer = httpx.request(
            method, f"{server.url}/api/records{path}", headers={"Authorization": f"Bearer {token}"}, **sent
        )
        return answer.status_code, answer.text

    assert httpx.post(f"{server.url}/api/records", json={}).status_code == 401
    assert ask("POST", "", UNSCOPED, json={})[0] == 403
    assert ask("GET", "/unknown/draft")[0] == 404
    assert ask("POST", "", content=b"{}")[0] == 415
    status, text = ask("POST", "", json={"metadata": {"title": "T"}})
    assert status == 201 and "metadata.creators" in text
    assert ask("POST", "/d1-x/draft/pids/doi")[0] == 201
    status, text = ask("POST", "/d1-x/draft/pids/doi")
    assert status == 400 and "A PID already exists" in text
    assert ask("POST", "/d1-x/draft/files", json=[{"key": "a"}])[0] == 201
    assert ask("POST", "/d1-x/draft/files", json=[{"key": "a"}])[0] == 400
    assert ask("POST", "/d1-x/draft/files/a/commit")[0] == 400
    binary = {"Authorization": f"Bearer {TOKEN}", "Content-Type": "application/octet-stream"}
    place = f"{server.url}/api/records/d1-x/draft/files/a/content"
    assert httpx.put(place, content=iter([b"x"]), headers=binary).status_code == 411
    assert httpx.put(place, content=bytes(MOST_BYTES + 1), headers=binary).status_code == 413
    assert "10.5281" in ask("GET", "/d1-x/draft")[1]
    assert ask("PUT", "/d1-x/draft", json={"metadata": {"title": "T"}})[0] == 200
    assert "10.5281" not in ask("GET", "/d1-x/draft")[1], "a PUT without pids loses the DOI"
    assert ask("POST", "/d1-x/draft/pids/doi")[0] == 400, "beyond repair"
