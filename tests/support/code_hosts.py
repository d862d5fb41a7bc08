"""Stand-ins of GitHub and GitLab: their comments over HTTP, and runners of the action and of the template."""

import fnmatch
import json
import re
import shutil
import subprocess
import sys
import threading
from contextlib import contextmanager
from dataclasses import dataclass, field
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from types import SimpleNamespace
from urllib.parse import parse_qs, urlsplit

import yaml

ROOT = Path(__file__).parents[2]
ACTION = ROOT / ".github" / "actions" / "vastflow" / "action.yml"
TEMPLATE = ROOT / "deployments" / "gitlab" / "vastflow.yml"
VASTFLOW = Path(sys.prefix) / "bin" / "vastflow"
TOKENS = {"token": "writes", "fork": "reads"}
GITHUB_USER, GITLAB_USER = {"login": "github-actions[bot]", "id": 41898282}, {"username": "project_7_bot", "id": 77}
MOST_CHARACTERS = 65_536

STAND_IN = f"""\
#!{sys.executable}
import json, os, sys
from pathlib import Path
command, *arguments = sys.argv[1:]
given = dict(zip(arguments, [*arguments[1:], ""]))
with open(os.environ["CALLS"], "a") as calls:
    calls.write(json.dumps(sys.argv[1:]) + "\\n")
code = int(os.environ.get(f"EXIT_{{command.upper()}}", 0))
if command == "run" and code != 2:
    directory = Path(given["--results"], "office-2026-01-30-120000")
    directory.mkdir(parents=True)
    (directory / "metadata.json").touch()
    Path(os.environ["VASTFLOW_STORE"]).mkdir(parents=True, exist_ok=True)
for option in ("--markdown", "--junit"):
    if option in given and code != 2:
        Path(given[option]).write_text(f"{{option[2:]}} of {{command}}\\n")
sys.exit(code)
"""
"""Stands in for `vastflow` where only the order of commands, their arguments, and their exit codes matter."""


class Comments(BaseHTTPRequestHandler):
    """Comments on request 7 of a repository, refused as GitHub and GitLab refuse them."""

    def do_GET(self):
        self._answer()

    do_POST = do_PATCH = do_PUT = do_GET

    def log_message(self, *_):
        """Print nothing."""

    def _answer(self):
        content = self.rfile.read(int(self.headers.get("Content-Length", 0)))
        code, said = self._answered(json.loads(content)["body"] if content else "")
        self.send_response(code)
        self.end_headers()
        self.wfile.write(json.dumps(said).encode())

    def _answered(self, body):
        path, asked = urlsplit(self.path).path, parse_qs(urlsplit(self.path).query)
        comments, at_github = self.server.comments, path.startswith("/repos/")
        token = (
            self.headers.get("Authorization", "").removeprefix("Bearer ")
            if at_github
            else self.headers.get("PRIVATE-TOKEN")
        )
        if token not in TOKENS:
            return 401, {"message": "Bad credentials"}
        user, by, most = (GITHUB_USER, "user", MOST_CHARACTERS) if at_github else (GITLAB_USER, "author", 10**6)
        if self.path == "/user":
            return 200, user
        place = "/repos/me/robot/issues/7/comments" if at_github else "/projects/5/merge_requests/7/notes"
        each = re.fullmatch((r"/repos/me/robot/issues/comments" if at_github else place) + r"/(\d+)", path)
        verb = {"POST": path == place, "GET": path == place, "PATCH": at_github and each, "PUT": not at_github and each}
        if not verb[self.command]:
            return 404, {"message": "Not Found"}
        if self.command == "GET":
            size, page = int(asked["per_page"][0]), int(asked["page"][0])
            assert size <= 100
            return 200, comments[size * (page - 1) : size * page]
        if TOKENS[token] == "reads":
            return 403, {"message": "Resource not accessible by integration"}
        if len(body) > most:
            return 422, {"message": "Validation Failed"}
        if self.command == "POST":
            comments.append({"id": 1000 + len(comments), "body": body, by: user})
            return 201, comments[-1]
        (comment,) = (comment for comment in comments if comment["id"] == int(each[1]))
        if not at_github and comment[by] != user:
            return 403, {"message": "403 Forbidden"}
        comment["body"] = body
        return 200, comment


@contextmanager
def comments_server():
    """Serve `comments`, a list, at `url`."""
    server = ThreadingHTTPServer(("127.0.0.1", 0), Comments)
    server.comments = []
    threading.Thread(target=server.serve_forever, daemon=True).start()
    try:
        yield SimpleNamespace(url=f"http://127.0.0.1:{server.server_port}", comments=server.comments)
    finally:
        server.shutdown()
        server.server_close()


@dataclass
class Done:
    """The exit code, log, summary, and kept files of a job."""

    code: int = 0
    log: str = ""
    summary: str = ""
    artifacts: list[str] = field(default_factory=list)
    calls: list[list[str]] = field(default_factory=list)


class Host:
    """Runs jobs in a folder each, with one cache, as a host of code does."""

    def __init__(self, place, api, vastflow=None):
        self.place, self.api, self.jobs = place, api, 0
        api.comments.clear()
        self.programs, self.cache = place / "programs", place / "cache"
        self.programs.mkdir(parents=True)
        self.git_log, self.calls = place / "git", place / "calls"
        if vastflow is None:
            vastflow = place / "vastflow"
            vastflow.write_text(STAND_IN)
            vastflow.chmod(0o755)
        linked = f"mkdir -p \"$4/bin\"; ln -sf '{self.programs}/pip' '{self.programs}/python' '{vastflow}' \"$4/bin\""
        self._program("python3", f'[ "$1 $2 $3" = "-m venv --clear" ] || exit 9; rm -rf "$4"; {linked}')
        self._program("python", f"exec '{sys.executable}' \"$@\"")
        self._program("pip", f'[ -f "$4" ] && [ -f "$5/pyproject.toml" ] && echo "$5" >> \'{place}/installed\'')
        self._program("git", f"echo \"$@\" >> '{self.git_log}'; ln -s '{ROOT}' \"$8\"")

    def _program(self, name, script):
        (self.programs / name).write_text(f"#!/bin/bash\nset -e\n{script}\n")
        (self.programs / name).chmod(0o755)

    def job(self, fill):
        """A new workspace, with the files of `fill` and nothing cached."""
        self.jobs += 1
        workspace = self.place / f"job{self.jobs}" / "robot"
        workspace.mkdir(parents=True)
        fill(workspace)
        self.calls.unlink(missing_ok=True)
        return workspace

    def environment(self, workspace, **more):
        return {
            "PATH": f"{self.programs}:/usr/bin:/bin",
            "HOME": str(self.place / "home"),
            "CALLS": str(self.calls),
            **more,
        }

    def ended(self, done, workspace, artifacts):
        found = [str(path.relative_to(workspace)) for path in sorted(workspace.rglob("*"))]
        done.artifacts = [path for path in found if any(fnmatch.fnmatch(path, pattern) for pattern in artifacts)]
        done.calls = [json.loads(line) for line in self.calls.read_text().splitlines()] if self.calls.exists() else []
        return done


def scripted(done, script, workspace, environment):
    """Add what a script says to the log, and return its exit code."""
    file = workspace.parent / "script.sh"
    file.write_text(script)
    command = ["bash", "--noprofile", "--norc", "-eo", "pipefail", str(file)]
    ran = subprocess.run(
        command,
        cwd=workspace,
        env=environment,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        check=False,
        timeout=300,
    )
    done.log += ran.stdout
    return ran.returncode


class GitHub(Host):
    """Runs the composite action, whose own steps are executed and whose actions are replaced."""

    def run(self, inputs, fill=lambda _: None, *, is_default=False, branch="feature", token="token", text=None, **more):
        action, workspace, done = yaml.safe_load(text or ACTION.read_text()), self.job(fill), Done()
        temporary = workspace.parent / "temporary"
        temporary.mkdir()
        inputs = {name: str(inputs.get(name, about.get("default"))) for name, about in action["inputs"].items()}
        contexts = {f"inputs.{name}": value for name, value in inputs.items()}
        contexts |= {"github.sha": f"sha{self.jobs}", "github.workspace": str(workspace)}
        contexts["inputs.comment == 'true' && github.token || ''"] = token if inputs["comment"] == "true" else ""
        contexts["steps.report.outputs.artifact-url"] = ""
        default = "github.ref {} format('refs/heads/{{0}}', github.event.repository.default_branch)"
        conditions = {
            None: True,
            "always()": True,
            default.format("=="): is_default,
            default.format("!="): not is_default,
        }
        event = {"repository": {"default_branch": "main"}} | (
            {} if is_default else {"pull_request": {"number": 7, "head": {"ref": branch}}}
        )
        (temporary / "event.json").write_text(json.dumps(event))
        environment = self.environment(workspace, RUNNER_TEMP=str(temporary), GITHUB_WORKSPACE=str(workspace), **more)
        environment |= {"GITHUB_ACTION_PATH": str(ACTION.parent), "GITHUB_EVENT_PATH": str(temporary / "event.json")}
        environment |= {"GITHUB_API_URL": self.api.url, "GITHUB_REPOSITORY": "me/robot", "GITHUB_HEAD_REF": branch}
        patterns = []
        for step in action["runs"]["steps"]:
            condition = step.get("if")
            if not conditions[condition] or (done.code and condition != "always()"):
                continue

            def resolved(value):
                return re.sub(r"\$\{\{ (.*?) \}\}", lambda found: contexts[found[1]], str(value))

            given = {name: resolved(value) for name, value in step.get("with", {}).items()}
            if "run" in step:
                summary = temporary / "summary.md"
                summary.touch()
                own = {name: resolved(value) for name, value in step.get("env", {}).items()}
                code = scripted(
                    done, resolved(step["run"]), workspace, {**environment, **own, "GITHUB_STEP_SUMMARY": str(summary)}
                )
                done.code = done.code or code
                done.summary = summary.read_text()
            elif "cache/restore" in step["uses"]:
                kept = sorted(self.cache.glob(given["restore-keys"] + "*"))
                if kept:
                    shutil.copytree(kept[-1], workspace / given["path"])
            elif "cache/save" in step["uses"]:
                shutil.copytree(workspace / given["path"], self.cache / given["key"])
            elif "upload-artifact" in step["uses"]:
                patterns = given["path"].split()
                contexts[f"steps.{step['id']}.outputs.artifact-url"] = (
                    "https://github.com/me/robot/actions/runs/1/artifacts/2"
                )
        return self.ended(done, workspace, patterns)


class GitLab(Host):
    """Runs the job of the template."""

    def run(self, inputs, fill=lambda _: None, *, is_default=False, branch="feature", token="token", text=None, **more):
        head, body = yaml.safe_load_all(text or TEMPLATE.read_text())
        inputs = {"vastflow": "https://example.org/vastflow.git", **inputs}
        inputs = {
            name: str(inputs.get(name, (about or {}).get("default"))) for name, about in head["spec"]["inputs"].items()
        }

        def resolved(value):
            if isinstance(value, dict):
                return {resolved(key): resolved(each) for key, each in value.items()}
            if isinstance(value, list):
                return [resolved(each) for each in value]
            return (
                re.sub(r"\$\[\[ inputs\.(\w+) \]\]", lambda found: inputs[found[1]], value)
                if isinstance(value, str)
                else value
            )

        ((name, job),) = resolved(body).items()
        workspace, done = self.job(fill), Done()
        own = job["variables"] | next(
            rule.get("variables", {}) for rule in job["rules"] if ("DEFAULT" in rule["if"]) == is_default
        )
        own = {
            key: value["value"] if isinstance(value, dict) else value.replace("$CI_PROJECT_DIR", str(workspace))
            for key, value in own.items()
        }
        environment = self.environment(
            workspace, **more, **own, CI_JOB_NAME=name, CI_JOB_URL="https://gitlab.com/me/robot/-/jobs/3"
        )
        environment |= {"CI_API_V4_URL": self.api.url, "CI_COMMIT_REF_NAME": branch, "VASTFLOW_GITLAB_TOKEN": token}
        if not is_default:
            environment |= {"CI_MERGE_REQUEST_IID": "7", "CI_MERGE_REQUEST_PROJECT_ID": "5"}
        kept = self.cache / job["cache"]["key"]
        if kept.exists():
            shutil.copytree(kept, workspace / ".vastflow")
        done.code = scripted(done, "\n".join(job["script"]), workspace, environment)
        scripted(done, "\n".join(job.get("after_script", [])), workspace, environment)
        if not done.code and own["VASTFLOW_CACHE"] == "pull-push":
            shutil.rmtree(kept, ignore_errors=True)
            shutil.copytree(workspace / ".vastflow", kept)
        bodies = [comment["body"] for comment in self.api.comments]
        done.summary = bodies[-1].partition("\n")[2] if bodies else ""
        assert job["artifacts"]["when"] == "always"
        return self.ended(done, workspace, [*job["artifacts"]["paths"], *job["artifacts"]["reports"].values()])
