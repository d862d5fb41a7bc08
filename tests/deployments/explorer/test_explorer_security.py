"""Security of the explorer: the token, hosts, origins, headers, and what lies outside the folders."""

import os
import shutil
import stat

import pytest
from starlette.testclient import TestClient
from table import each_row

from vastflow.deployments.explorer.directories import Directories
from vastflow.deployments.explorer.server import application
from vastflow.deployments.explorer.serving import LOOPBACK, listen, redirect_page
from vastflow.sim.model.faults import UserError

TOKEN = "a-token-of-the-tests"
PLACE = "http://127.0.0.1:8000"


def test_token_becomes_a_strict_cookie_and_leaves_the_address(stranger):
    reply = stranger.get("/campaign", params={"c": "a&b=<x>", "token": TOKEN, "f": ""})
    assert (reply.status_code, reply.headers["location"]) == (303, "/campaign?c=a%26b%3D%3Cx%3E&f=")
    cookie = reply.headers["set-cookie"]
    assert cookie.startswith("vastflow-") and "HttpOnly" in cookie and "SameSite=strict" in cookie
    assert stranger.get("/").status_code == 200


@each_row("query", ["", "?token=", "?token=other", "?token=%ff", f"?token={TOKEN[:-1]}", f"?Token={TOKEN}"])
@each_row("path", ["/", "/api/events", "/campaign", "/compare", "/nowhere"])
def test_request_without_the_token_is_refused(stranger, path, query):
    reply = stranger.get(path + query)
    assert (reply.status_code, "carries the token" in reply.text) == (403, True)


def test_wrong_token_is_refused_despite_the_cookie(client):
    assert client.get("/?token=other").status_code == 403


def test_cookies_are_bound_to_the_server_by_name_and_content(client, results):
    other = TestClient(application(Directories([results]), TOKEN), PLACE, follow_redirects=False)
    other.get("/", params={"token": TOKEN})
    ((name, content),), ((its_name, its_content),) = client.cookies.items(), other.cookies.items()
    assert name != its_name and content != its_content and TOKEN not in name + content
    alone = TestClient(application(Directories([results]), TOKEN), PLACE, follow_redirects=False)
    for given in (content, its_content, TOKEN):
        assert alone.get("/", headers={"cookie": f"{name}={given}; {its_name}={given}"}).status_code == 403
    elsewhere = {"host": "127.0.0.1:8001", "cookie": f"{name}={content}"}
    assert client.get("/", headers=elsewhere).status_code == 403


def test_token_of_the_redirect_page_is_good_for_one_exchange(results):
    app = application(Directories([results]), TOKEN, ["once"])
    first, second = (TestClient(app, PLACE, follow_redirects=False) for _ in range(2))
    reply = first.get("/?token=once&f=1", headers={"sec-fetch-site": "cross-site"})
    assert (reply.status_code, reply.headers["refresh"]) == (200, "0; url=/?f=1")
    assert first.get("/").status_code == 200
    assert [each.get("/?token=once").status_code for each in (first, second)] == [403, 403]


def test_browser_is_given_a_page_that_only_its_user_can_read(tmp_path):
    page = redirect_page(tmp_path, "http://127.0.0.1:8000/?token=secret")
    assert stat.S_IMODE(page.stat().st_mode) == 0o600
    assert "url=http://127.0.0.1:8000/?token=secret" in page.read_text()
    with pytest.raises(FileExistsError, match="exists"):
        redirect_page(tmp_path, "http://127.0.0.1:8000/")


@each_row(
    "host",
    [
        *("evil.example", "evil.example:8000", "127.0.0.1.evil.example", "localhost.evil.example:8000", ""),
        *("127.0.0.2", "0.0.0.0:8000", "127.0.0.1@evil.example", "evil.example#127.0.0.1", "127.0.0.1:x", "[::1"),
    ],
)
def test_foreign_host_is_refused_with_a_page(client, host):
    reply = client.get("/", headers={"host": host})
    assert (reply.status_code, "answers at 127.0.0.1" in reply.text) == (421, True)


@each_row("host", ["127.0.0.1:8000", "localhost:9999", "localhost", "[::1]:8000"])
def test_names_of_this_machine_are_answered(stranger, host):
    assert stranger.get(f"/?token={TOKEN}", headers={"host": host}).status_code == 303


@each_row("origin", [None, "null", "http://evil.example", "http://127.0.0.1:8001", "https://127.0.0.1:8000"])
@each_row("method", ["POST", "PUT", "DELETE", "OPTIONS"])
def test_change_from_foreign_origin_is_refused(client, method, origin):
    headers = {} if origin is None else {"origin": origin}
    reply = client.request(method, "/", headers=headers)
    assert (reply.status_code, "own pages only" in reply.text) == (403, True)


def test_change_from_own_origin_reaches_the_page(client):
    assert client.post("/", headers={"origin": "http://127.0.0.1:8000"}).status_code == 405


@each_row("path", ["/", "/nowhere", "/static/dom.js", "/static/nothing", "/api/nothing"])
def test_replies_forbid_foreign_and_inline_content(client, path):
    headers = client.get(path).headers
    policy = headers["content-security-policy"]
    assert "default-src 'self'" in policy and "frame-ancestors 'none'" in policy and "unsafe" not in policy
    assert headers["x-content-type-options"] == "nosniff"


@each_row(
    "path",
    [
        *("/static/nothing.js", "/static/../server.py", "/static/%2e%2e/server.py", "/static/..%2fserver.py"),
        *("/static//etc/passwd", "/static/%2fetc%2fpasswd", "/static/", "/static/.", "/etc/passwd"),
    ],
)
def test_static_names_are_looked_up(client, path):
    reply = client.get(path)
    assert reply.status_code in (404, 307) and "root:" not in reply.text and "Starlette" not in reply.text


@each_row("path", ["/campaign", "/compare", "/live", "/configuration", "/run"])
@each_row("id", ["", "..", "../..", "%2e%2e%2f", "/etc", "office-2026-11-20-060000", "<script>alert(1)</script>"])
def test_unknown_id_is_a_page_of_one_sentence(client, add_campaign, path, id):
    add_campaign(20, {"room": [1]})
    reply = client.get(f"{path}?c={id}&a={id}&b={id}")
    assert reply.status_code in (400, 404) and "<script>alert" not in reply.text


def test_names_with_markup_are_shown_as_text(client, add_campaign):
    add_campaign(20, {"<img src=x onerror=alert(1)>": [1]}, name="<script>alert(1)<-script>")
    page = client.get("/").text
    assert "<script>alert(1)" not in page and "&lt;script&gt;alert(1)" in page


def test_link_out_of_the_folder_is_not_followed(client, results, add_campaign, tmp_path):
    outside = add_campaign(20, {"room": [1]}, name="secret")
    shutil.move(outside, tmp_path / "elsewhere")
    os.symlink(tmp_path / "elsewhere", results / "linked")
    assert "secret" not in client.get("/").text


@pytest.mark.parametrize("name", ["metadata.json", "campaign.vast", "verdicts.parquet", "recordings"])
def test_directory_with_link_to_the_outside_is_damaged(client, add_campaign, tmp_path, name):
    directory = add_campaign(20, {"room": [1]})
    shutil.move(directory / name, tmp_path / "elsewhere")
    os.symlink(tmp_path / "elsewhere", directory / name)
    assert f"{name} is a link out of the directory" in client.get("/").text


def test_socket_listens_on_this_machine_only():
    with listen(0) as listening:
        assert listening.getsockname()[0] == LOOPBACK == "127.0.0.1"
        with pytest.raises(UserError, match="Choose a free port"):
            listen(listening.getsockname()[1])


def test_failing_page_gives_one_sentence_with_headers(client, monkeypatch):
    def fails(self):
        raise RuntimeError("of the test")

    monkeypatch.setattr("vastflow.deployments.explorer.directories.Directories.all", fails)
    reply = client.get("/")
    assert (reply.status_code, "Traceback" in reply.text) == (500, False)
    assert "The explorer failed: RuntimeError: of the test" in reply.text
    assert "default-src" in reply.headers["content-security-policy"]
