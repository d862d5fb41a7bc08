"""The GitHub action and the GitLab template: their scripts in order, with stand-ins of the hosts and of `vastflow`."""

import json
import re
import sys
from pathlib import Path

import pytest
import yaml
from code_hosts import ACTION, MOST_CHARACTERS, ROOT, TEMPLATE, VASTFLOW, GitHub, GitLab, comments_server
from table import each_row

from vastflow.deployments.comment import main, summary_of
from vastflow.flows.terminal.markdown import MAX_BYTES

CAMPAIGN = {"campaign": "navigation/office.vast"}
DIRECTORY = "candidate/office-2026-01-30-120000"
HOSTS = (GitHub, GitLab)
RUN = ["run", "navigation/office.vast", "--results", "candidate"]
COMPARE = [
    "compare",
    ".vastflow/baseline",
    f"{DIRECTORY}/",
    "--gate",
    "--margin",
    "0.02",
    "--junit",
    "candidate/compare.xml",
]


@pytest.fixture
def api():
    with comments_server() as server:
        yield server


def with_baseline(kind, tmp_path, api, **more):
    """A host whose default branch has kept a baseline."""
    host = kind(tmp_path / kind.__name__, api, **more)
    assert host.run(CAMPAIGN, is_default=True).code == 0
    api.comments.clear()
    return host


def only(comments):
    """The body of our only comment."""
    found = own(comments)
    assert len(found) == 1, "expected one comment"
    return found[0]


def own(comments):
    return [comment["body"] for comment in comments if comment["body"].startswith("<!-- vastflow ")]


@each_row("kind", HOSTS)
def test_first_change_without_baseline_passes_and_says_so(kind, tmp_path, api):
    done = kind(tmp_path / "host", api).run(CAMPAIGN)
    assert (done.code, [call[0] for call in done.calls]) == (0, ["run", "show"]), done.log
    assert done.calls[0] == RUN
    comment = only(api.comments)
    for text in (comment, done.summary):
        assert "No baseline yet: the default branch makes one." in text and "markdown of show" in text
    assert (tmp_path / "host" / "installed").exists()


@each_row("kind", HOSTS)
def test_default_branch_keeps_baseline_that_change_is_compared_with(kind, tmp_path, api):
    host = kind(tmp_path / "host", api)
    for _ in range(2):
        done = host.run(CAMPAIGN, is_default=True)
        assert done.calls == [RUN, ["store", "gc", "--keep", ".vastflow/baseline"], done.calls[2]]
    assert not own(api.comments)
    (kept,) = list(host.cache.glob("*"))[-1:]
    assert (kept / "baseline" / "metadata.json").exists() and (kept / "store").exists()
    assert not (kept / "baseline" / Path(DIRECTORY).name).exists()
    before = sorted(host.cache.rglob("*"))
    done = host.run(CAMPAIGN)
    assert (done.code, done.calls[0], done.calls[1][:8]) == (0, RUN, COMPARE), done.log
    assert "markdown of compare" in done.summary
    assert sorted(host.cache.rglob("*")) == before  # a change replaces nothing


@each_row("kind", HOSTS)
def test_gate_that_fails_ends_job_with_its_code_and_is_summarized(kind, tmp_path, api):
    check_failed_gate(with_baseline(kind, tmp_path, api), api, tmp_path)


def check_failed_gate(host, api, tmp_path, text=None):
    done = host.run(CAMPAIGN, EXIT_COMPARE="1", text=text)
    assert done.code == 1, "the exit code is lost"
    comment = only(api.comments)
    for words in (done.summary, comment):
        parts = re.findall("markdown of compare|<details>|markdown of show", words)
        assert parts == ["markdown of compare", "<details>", "markdown of show"], "the summary lacks a part"
        assert re.search(r"\[Report and pictures\]\(<https://git(hub|lab)\.com/me/robot/\S+>\)", words), "no link"
    assert "candidate/compare.xml" in done.artifacts, "no JUnit file"


@each_row("kind", HOSTS)
def test_comparison_that_breaks_ends_job_with_its_code_and_is_summarized(kind, tmp_path, api):
    done = with_baseline(kind, tmp_path, api).run(CAMPAIGN, EXIT_COMPARE="2")
    assert done.code == 2
    assert "❌ The gate has no result." in only(api.comments) and "markdown of show" in only(api.comments)


@each_row("kind", HOSTS)
def test_campaign_that_cannot_run_ends_job_with_its_code_and_is_summarized(kind, tmp_path, api):
    host = with_baseline(kind, tmp_path, api)
    done = host.run(CAMPAIGN, EXIT_RUN="2")
    assert (done.code, done.calls) == (2, [RUN])
    comment = only(api.comments)
    for words in (done.summary, comment):
        assert "❌ The campaign has no results." in words and "Report" not in words
    api.comments.clear()
    done = host.run(CAMPAIGN, EXIT_RUN="3")  # faults, with results
    assert (done.code, [call[0] for call in done.calls]) == (3, ["run", "show"])
    assert "markdown of show" in done.summary and "no results" not in done.summary
    done = host.run(CAMPAIGN, is_default=True, EXIT_RUN="3")
    assert [call[0] for call in done.calls] == ["run", "show"]  # and the baseline stays


@each_row("kind", HOSTS)
def test_later_job_changes_own_comment_and_never_that_of_others(kind, tmp_path, api):
    host = with_baseline(kind, tmp_path, api)
    host.run(CAMPAIGN)
    mark = api.comments[0]["body"].partition("\n")[0]
    by = "user" if kind is GitHub else "author"
    forged = [{"id": k, "body": f"{mark}\nignore the gate", by: {"login": "stranger", "id": 666}} for k in range(250)]
    api.comments[:0] = forged
    done = host.run(CAMPAIGN, EXIT_COMPARE="1")
    assert (done.code, len(api.comments), done.log.count("changed the comment")) == (1, 251, 1)
    assert all(comment["body"].endswith("ignore the gate") for comment in api.comments[:250])
    assert "markdown of compare" in api.comments[-1]["body"]
    host.run({**CAMPAIGN, ("name" if kind is GitHub else "job"): "other"})
    assert len(api.comments) == 252


REFUSED = "no comment: the server answered"
NOWHERE = "no comment: no pull or merge request, or no token"
TROUBLES = [
    (GitHub, {"GITHUB_TOKEN": "fork"}, f"{REFUSED} 403 Forbidden"),
    (GitHub, {"GITHUB_TOKEN": "wrong"}, f"{REFUSED} 401 Unauthorized"),
    (GitHub, {"GITHUB_TOKEN": ""}, NOWHERE),
    (GitHub, {"GITHUB_REPOSITORY": "me/other"}, f"{REFUSED} 404 Not Found"),
    (GitHub, {"GITHUB_API_URL": "http://127.0.0.1:9"}, "no comment: [Errno 111] Connection refused"),
    (GitHub, {"GITHUB_EVENT_PATH": "push.json"}, NOWHERE),
    (GitLab, {"VASTFLOW_GITLAB_TOKEN": "fork"}, f"{REFUSED} 403 Forbidden"),
    (GitLab, {"VASTFLOW_GITLAB_TOKEN": "wrong"}, f"{REFUSED} 401 Unauthorized"),
    (GitLab, {"VASTFLOW_GITLAB_TOKEN": ""}, NOWHERE),
    (GitLab, {"CI_MERGE_REQUEST_PROJECT_ID": "6"}, f"{REFUSED} 404 Not Found"),
    (GitLab, {"CI_MERGE_REQUEST_IID": "", "GITHUB_TOKEN": "token"}, NOWHERE),
]


@each_row(("kind", "more", "words"), TROUBLES)
def test_refused_comment_is_one_line_and_no_failure(kind, more, words, tmp_path, api, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    for name, event in (("pull", {"pull_request": {"number": 7}}), ("push", {})):
        Path(f"{name}.json").write_text(json.dumps(event))
    github = {
        "GITHUB_EVENT_PATH": "pull.json",
        "GITHUB_API_URL": api.url,
        "GITHUB_REPOSITORY": "me/robot",
        "GITHUB_TOKEN": "token",
    }
    gitlab = {"CI_API_V4_URL": api.url, "CI_MERGE_REQUEST_PROJECT_ID": "5", "CI_MERGE_REQUEST_IID": "7"}
    gitlab |= {"VASTFLOW_GITLAB_TOKEN": "token"}
    for name in (*github, *gitlab):
        monkeypatch.delenv(name, raising=False)
    for name, value in ((github if kind is GitHub else gitlab) | more).items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("GITHUB_STEP_SUMMARY", "summary.md")
    monkeypatch.setattr(sys, "argv", ["comment", "campaign", "", "gate.md", "campaign.md"])
    main()
    assert (capsys.readouterr().out, api.comments) == (f"{words}\n", [])
    assert Path("summary.md").read_text().startswith("### campaign\n")


def test_fork_gets_summary_and_no_comment(tmp_path, api):
    done = GitHub(tmp_path / "host", api).run(CAMPAIGN, token="fork")
    assert (done.code, api.comments) == (0, []) and "markdown of show" in done.summary
    assert [line for line in done.log.splitlines() if "comment" in line] == [f"{REFUSED} 403 Forbidden"]


def test_action_makes_no_comment_where_none_is_asked_for(tmp_path, api):
    done = GitHub(tmp_path / "host", api).run({**CAMPAIGN, "comment": "false"})
    assert (done.code, api.comments) == (0, []) and "markdown of show" in done.summary


@each_row("kind", HOSTS)
def test_baseline_that_is_named_and_missing_is_no_first_run(kind, tmp_path, api):
    done = kind(tmp_path / "host", api).run({**CAMPAIGN, "baseline": "not/there"})
    assert done.calls[1][:3] == ["compare", "not/there", f"{DIRECTORY}/"]


HOSTILE = "$(touch pwned)`touch pwned`; touch pwned # \"' .vast"


@each_row("kind", HOSTS)
def test_hostile_names_are_no_commands(kind, tmp_path, api):
    check_hostile_names(with_baseline(kind, tmp_path, api), api, tmp_path)


def check_hostile_names(host, api, tmp_path, text=None):
    hostile = {"campaign": HOSTILE, "results": "$(touch pwned)", "margin": "`touch pwned`"}
    done = host.run(hostile, branch="$(touch${IFS}pwned)", text=text)
    assert done.calls[:1] == [["run", HOSTILE, "--results", "$(touch pwned)"]], "other arguments"
    assert done.calls[1][4:6] == ["--margin", "`touch pwned`"], "other arguments"
    assert (done.code, list(tmp_path.rglob("pwned"))) == (0, [])


@each_row("kind", HOSTS)
def test_modules_of_repository_are_not_executed_beside_the_token(kind, tmp_path, api):
    check_shadowing_modules(kind(tmp_path / "host", api), api, tmp_path)


def check_shadowing_modules(host, api, tmp_path, text=None):
    def fill(workspace):
        for name in ("httpx", "vastflow"):
            (workspace / f"{name}.py").write_text("open('pwned', 'w')\n")

    done = host.run(CAMPAIGN, fill, text=text)
    assert not list(tmp_path.rglob("pwned")), "executed"
    assert (done.code, len(own(api.comments))) == (0, 1)


DEFECTS = [
    (GitHub, "      if: always()\n      shell", "      shell", check_failed_gate, "expected one comment"),
    (GitHub, "      if: always()\n      uses", "      uses", check_failed_gate, "no link"),
    (GitHub, 'gate.md"\n        else', 'gate.md" | cat || true\n        else', check_failed_gate, "exit code is lost"),
    (GitHub, '\n          "$RUNNER_TEMP/vastflow/gate.md" ', "\n          ", check_failed_gate, "expected one comment"),
    (GitHub, 'run "$CAMPAIGN"', 'run "${{ inputs.campaign }}"', check_hostile_names, "other arguments"),
    (GitHub, '--margin "$MARGIN"', "--margin ${{ inputs.margin }}", check_hostile_names, "other arguments"),
    (GitHub, 'python" -P', 'python"', check_shadowing_modules, "executed"),
    (GitLab, "  after_script:\n", "", check_failed_gate, "expected one comment"),
    (GitLab, '/gate.md"\n      else', '/gate.md" || true\n      else', check_failed_gate, "exit code is lost"),
    (GitLab, '"$VASTFLOW_CAMPAIGN"', '"$[[ inputs.campaign ]]"', check_hostile_names, "other arguments"),
    (GitLab, 'python" -P', 'python"', check_shadowing_modules, "executed"),
]


@pytest.mark.slow
@each_row(("kind", "right", "wrong", "check", "words"), DEFECTS)
def test_checks_above_see_planted_defect(kind, right, wrong, check, words, tmp_path, api):
    text = (ACTION if kind is GitHub else TEMPLATE).read_text()
    assert text.count(right) == 1, right
    with pytest.raises(AssertionError, match=words):
        check(with_baseline(kind, tmp_path, api), api, tmp_path, text.replace(right, wrong))


def test_longest_summary_fits_into_comment():
    body = summary_of("x" * 100, "https://example.org/" + "x" * 500, "é" * (MAX_BYTES // 2), "x" * MAX_BYTES)
    assert len(body) + 100 < len(body.encode()) + 100 < MOST_CHARACTERS


def test_action_has_only_known_keys_and_no_expression_in_scripts():
    action = yaml.safe_load(ACTION.read_text())
    assert action.keys() == {"name", "description", "inputs", "runs"} and action["runs"]["using"] == "composite"
    steps = action["runs"]["steps"]
    for step in steps:
        assert step.keys() <= {"name", "id", "if", "shell", "env", "run", "uses", "with"}
        assert ("run" in step) != ("uses" in step) and step.get("shell") == ("bash" if "run" in step else None)
        assert "${{" not in step.get("run", "")
    workflow = (ROOT / ".github" / "workflows" / "ci.yml").read_text()
    assert {re.sub(r"\d+$", "", step["uses"].rpartition("@")[2]) for step in steps if "uses" in step} == {"v"}
    assert steps[0]["uses"] in workflow
    read = set(re.findall(r"inputs\.([\w-]+)", str(steps)))
    assert read == action["inputs"].keys()


def test_template_has_inputs_in_variables_and_not_in_scripts():
    head, body = yaml.safe_load_all(TEMPLATE.read_text())
    ((_, job),) = body.items()
    assert set(re.findall(r"inputs\.(\w+)", str(body))) == head["spec"]["inputs"].keys()
    assert "$[[" not in str([job["script"], job["after_script"]])
    for name, value in job["variables"].items():
        assert name.startswith("VASTFLOW_")
        assert "$[[" not in str(value) or value["expand"] is False
        assert f"${name}" in str(job) or f"${{{name}" in str(job) or name == "VASTFLOW_STORE"


def test_page_uses_action_and_template_by_their_inputs():
    page = (ROOT / "docs" / "in-ci.md").read_text()
    (workflow, pipeline) = map(yaml.safe_load, re.findall(r"^```yaml \S+\n(.*?)^```$", page, re.MULTILINE | re.DOTALL))
    (step,) = [step for step in workflow["jobs"]["campaign"]["steps"] if "vastflow" in step["uses"]]
    assert (ROOT / step["uses"].partition("vastflow/")[2].partition("@")[0] / "action.yml") == ACTION
    (included,) = pipeline["include"]
    assert ROOT / included["file"].lstrip("/") == TEMPLATE
    action = yaml.safe_load(ACTION.read_text())["inputs"]
    template = next(yaml.safe_load_all(TEMPLATE.read_text()))["spec"]["inputs"]
    for inputs, given, title in ((action, step["with"], "GitHub Actions"), (template, included["inputs"], "GitLab CI")):
        needed = {name for name, about in inputs.items() if "default" not in about}
        assert needed <= given.keys() <= inputs.keys()
        text = page.partition(f"## {title}")[2].partition("\n## ")[0]
        cells = re.findall(r"^\| (`[^|]*) \|", text, re.MULTILINE)
        assert {name for cell in cells for name in re.findall(r"`([^`]+)`", cell)} == inputs.keys()


WAITS = """\
version: 1
metadata: {name: waits}
configuration:
  - {name: "long", parameters: [{span: 2.0}]}
  - {name: "short", parameters: [{span: 1.0}]}
execution: {scenario_file: waits.osc, runs: 20, timeout: 30}
evaluation: {oracles: [{"own.py:Own": {}}]}
"""
WAIT = "import osc.helpers\nscenario waits:\n    timeout(30s)\n    span: float\n    do wait elapsed(1s)\n"
OWN = """\
from vastflow.oracles.judgment.oracle import Oracle, Parameters

class Own(Oracle[Parameters]):
    Parameters = Parameters
    metrics = {}

    def judge(self, trace, situation):
        return self.passed(trace)
"""


@pytest.mark.slow
def test_real_campaign_passes_unchanged_and_fails_by_gate_after_change(tmp_path, api, prefect_home):
    def campaign(campaign=WAITS, oracle=OWN):
        def fill(workspace):
            for name, text in (("`id`.vast", campaign), ("waits.osc", WAIT), ("own.py", oracle)):
                (workspace / name).write_text(text)

        return fill

    host = GitHub(tmp_path / "host", api, VASTFLOW)
    own_place = {"PREFECT_HOME": str(prefect_home(tmp_path / "prefect")), "LC_ALL": "C.UTF-8"}
    inputs = {"campaign": "`id`.vast"}
    done = host.run(inputs, campaign(), is_default=True, **own_place)
    assert done.code == 0, done.log
    done = host.run(inputs, campaign(), **own_place)
    assert (done.code, "0 runs executed, 40 from the store" in done.log) == (0, True), done.log
    assert "✅ **gate holds: nothing changed" in only(api.comments)
    fails = OWN.replace("self.passed(trace)", 'self.failed(trace, "<b>@all</b>")')
    done = host.run(inputs, campaign(oracle=fails), **own_place)
    assert done.code == 1, done.log
    for words in (done.summary, only(api.comments)):
        assert "❌ **gate does not hold" in words and "2 of 2 configurations with failed runs" in words
    assert {Path(each).suffix for each in done.artifacts} >= {".html", ".xml"}
    done = host.run(inputs, campaign(WAITS.replace("runs: 20", "runs: no")), **own_place)
    assert (done.code, "runs: expected" in done.log, "Traceback" in done.log) == (2, True, False), done.log
    assert "The campaign has no results" in only(api.comments)
