"""The summary of a job in CI, and the comment on its pull or merge request.

`python -m vastflow.deployments.comment NAME REPORT GATE CAMPAIGN`: the address of the report, and files of Markdown, which may be missing.
"""

import hashlib
import os
import sys
from collections.abc import Iterator, Mapping
from dataclasses import dataclass
from typing import Any, Final

import httpx

from vastflow.flows.terminal.markdown import escaped
from vastflow.sim.model.files import is_file, read_json, read_text

PAGE: Final = 100
"""Comments that one request returns, the most at both places."""
GITHUB_USER: Final = "github-actions[bot]"
"""The author of comments that are written with the token of a job."""


@dataclass(frozen=True, slots=True)
class Thread:
    """The comments on one pull or merge request.

    Attributes:
        place: Where comments are listed and added, below the client's base.
        each: Where one is changed by `method`, followed by its number.
        author: Our own name or number: comments of others are never changed, whatever is in them.
    """

    client: httpx.Client
    place: str
    each: str
    method: str
    author: str | int

    def write(self, body: str, mark: str) -> str:
        """Write the comment that begins with a mark, in place of an earlier one, and return what was done.

        Raises:
            httpx.HTTPError, ValueError: it was refused, or the server can't be reached or understood.
        """
        for comment in self._comments():
            by = comment.get("user") or comment.get("author") or {}
            if comment["body"].startswith(mark) and self.author in (by.get("login"), by.get("id")):
                self._asked(self.method, f"{self.each}/{comment['id']}", json={"body": body})
                return "changed the comment of an earlier job"
        self._asked("POST", self.place, json={"body": body})
        return "commented"

    def _comments(self) -> Iterator[dict[str, Any]]:
        page = 0
        found: list[dict[str, Any]] = [{}] * PAGE
        while len(found) == PAGE:
            page += 1
            found = self._asked("GET", self.place, params={"per_page": PAGE, "page": page})
            yield from found

    def _asked(self, method: str, path: str, **content: Any) -> Any:
        return self.client.request(method, path, **content).raise_for_status().json()


def thread_of(environment: Mapping[str, str]) -> Thread | None:
    """Return the comments on a job's request; None without a token or a request."""
    if event := environment.get("GITHUB_EVENT_PATH"):
        token, number = (
            environment.get("GITHUB_TOKEN"),
            read_json(event).get("pull_request", {}).get("number"),
        )
    else:
        token, number = environment.get("VASTFLOW_GITLAB_TOKEN"), environment.get("CI_MERGE_REQUEST_IID")
    if not (token and number):
        return None
    if event:
        base = f"{environment['GITHUB_API_URL']}/repos/{environment['GITHUB_REPOSITORY']}/issues"
        client = httpx.Client(base_url=base, headers={"Authorization": f"Bearer {token}"}, timeout=30.0)
        return Thread(client, f"{number}/comments", "comments", "PATCH", GITHUB_USER)
    client = httpx.Client(base_url=environment["CI_API_V4_URL"], headers={"PRIVATE-TOKEN": token}, timeout=30.0)
    notes = f"projects/{environment['CI_MERGE_REQUEST_PROJECT_ID']}/merge_requests/{number}/notes"
    return Thread(client, notes, notes, "PUT", client.get("user").raise_for_status().json()["id"])


def summary_of(name: str, report: str, gate: str, campaign: str) -> str:
    """Return the Markdown of a job: the gate, then the campaign, which is folded below a gate."""
    if gate and campaign:
        campaign = f"<details><summary>This campaign</summary>\n\n{campaign}\n</details>\n"
    failed = "❌ The campaign has no results. The log of the job has the reason.\n"
    link = f"[Report and pictures](<{report}>)\n" if report and campaign else ""
    return "\n".join(part for part in (f"### {escaped(name)}\n", gate, campaign or failed, link) if part)


def main() -> None:
    """Write the summary and the comment; a comment that can't be written never fails the job."""
    name, report, *files = sys.argv[1:]
    body = summary_of(name, report, *(read_text(file) if is_file(file) else "" for file in files))
    if summary := os.environ.get("GITHUB_STEP_SUMMARY"):
        with open(summary, "a", encoding="utf-8") as file:
            file.write(body)
    mark = f"<!-- vastflow {hashlib.sha256(name.encode()).hexdigest()[:16]} -->\n"
    try:
        thread = thread_of(os.environ)
        print(
            "no comment: no pull or merge request, or no token" if thread is None else thread.write(mark + body, mark)
        )
    except httpx.HTTPStatusError as error:
        print(f"no comment: the server answered {error.response.status_code} {error.response.reason_phrase}")
    except (httpx.HTTPError, ValueError) as error:
        print(f"no comment: {error}")


if __name__ == "__main__":
    main()
