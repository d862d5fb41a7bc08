"""Markdown of what the terminal shows: whole, bounded, and without anything that a name could do in a comment."""

import re
from xml.etree import ElementTree

from command_line import called, refused
from hypothesis import given, settings
from hypothesis import strategies as st
from judged_directory import same, write
from markdown_it import MarkdownIt
from rich.text import Text
from table import each_row

from vastflow.flows.terminal.display import terminal_table
from vastflow.flows.terminal.markdown import MAX_BYTES, markdown_of

PARSER = MarkdownIt("commonmark", {"html": True}).enable(["table", "strikethrough"])
TAGS = {*("body", "p", "strong", "table", "thead", "tbody", "tr", "th", "td")}
LINKS = re.compile(r"(?<!\w)[@#!~$&%]\w|://|www\.|GH-\d", re.IGNORECASE)
"""What GitHub and GitLab link where it is in a text, however the text came about."""
HOSTILE = [
    "a | b",
    "`ls`",
    "``x` `",
    "<img src=x onerror=alert(1)>",
    "<!-- -->",
    "@maintainers look",
    "![](https://example.org/p.png)",
    "[here](javascript:x)",
    "https://example.org www.example.org a@example.org",
    "# heading",
    "- item\n- item",
    "/merge",
    "x\n/close\n",
    "\\",
    "a\\|b",
    "&lt; &copy;",
    "~~struck~~ **bold** _it_",
    "#12 !3 GH-7 owner/repo#1",
    ":smile: $x$",
    "$(touch pwned)",
    "1. one",
    "    code",
    "\u202eevil",
    "---",
    "=== \r\n ===",
]


def visible(text):
    """The text as one line, as a reader would see it."""
    return " ".join("".join(each if each.isprintable() else " " for each in text).split())


def rendered(markdown):
    html = PARSER.render(markdown)
    return ElementTree.fromstring(f"<body>{html}</body>")


def check(name):
    for line in (Text(name), terminal_table(("name",), rows=[(name,)]), Text(f"failed: {name}", "red")):
        source = markdown_of([line, "end"])
        body = rendered(source)
        read = "".join(body.itertext())
        assert visible(name) in visible(read.replace("\N{ZERO WIDTH SPACE}", ""))
        assert {each.tag for each in body.iter()} <= TAGS
        assert not LINKS.search(read)
        assert all(each.isprintable() or each in "\n\N{ZERO WIDTH SPACE}" for each in source)
        assert not re.search(r"^\s*/", source, re.MULTILINE)
        assert len(body.findall(".//td")) <= 1


@each_row("name", HOSTILE)
def test_hostile_name_is_shown_as_it_is_and_is_no_markup(name):
    check(name)


@settings(max_examples=300, deadline=None)
@given(
    st.text(
        st.sampled_from("ab1 |\\`*_<>[](){}@#!:/.-~&$\n\t") | st.characters(exclude_categories=["Cs", "Cc"]),
        max_size=30,
    )
)
def test_any_name_is_shown_as_it_is_and_is_no_markup(name):
    check(name)


def test_table_keeps_columns_alignment_and_header():
    table = terminal_table(("family",), ("runs", "rate"), rows=[("a|b", "3", "100.0 %"), ("c", "4", "–")])
    body = rendered(markdown_of([Text("76 % passed", "bold"), table, Text("gate holds: x", "green")]))
    assert [each.text for each in body.findall(".//th")] == ["family", "runs", "rate"]
    assert [each.text for each in body.findall(".//td")] == ["a|b", "3", "100.0\N{NO-BREAK SPACE}%", "c", "4", "–"]
    assert [each.get("style") for each in body.findall(".//th")] == [None, *["text-align:right"] * 2]
    assert ["".join(each.itertext()) for each in body.findall("p")] == ["76 % passed", "✅ gate holds: x"]


def test_markdown_is_bounded_and_counts_what_it_leaves_out():
    rows = [(f"configuration-{k}", "x" * 5_000) for k in range(2_000)]
    found = markdown_of([Text("headline"), terminal_table(("name", "reason"), rows=rows)])
    assert MAX_BYTES / 2 < len(found.encode()) < MAX_BYTES
    left_out = int(re.search(r"^([\d,]+) more lines are left out here", found, re.MULTILINE)[1].replace(",", ""))
    assert left_out == 2_000 - found.count("configuration") + 1  # and the blank line behind the table
    assert rendered(found).findall("p")[-1].text.startswith(f"{left_out:,} more lines")
    assert "left out" not in markdown_of([terminal_table(("name",), rows=[("x",)] * 100)])
    assert len(markdown_of([Text("é" * 10**6)])) < 600


def test_compare_writes_gate_first_and_show_only_failing_configurations(tmp_path):
    before = write(tmp_path / "before", same("p" * 10))
    worse = write(tmp_path / "worse", {**same("p" * 10, system=1), "c3": (3, 1, "f" * 10), "c5": (5, 1, "fffpppppff")})
    result = called("compare", before, worse, "--gate", "--markdown", tmp_path / "gate.md")
    assert result.exit_code == 1 and "newly failing: 1 configuration" in result.stdout
    body = rendered((tmp_path / "gate.md").read_text())
    assert "".join(body[0].itertext()).startswith("❌ gate does not hold: a loss of")
    assert "c3" in [each.text for each in body.findall(".//td")]
    assert called("show", worse, "--markdown", tmp_path / "show.md").exit_code == 0
    body = rendered((tmp_path / "show.md").read_text())
    assert "2 of 12 configurations with failed runs" in "".join(body.itertext())
    assert [each[0].text for each in body.findall("table")[-1].findall(".//tr")] == ["configuration", "c3", "c5"]


def test_markdown_is_refused_beside_other_views_and_in_missing_folder(tmp_path):
    directory = write(tmp_path / "a", same("p"))
    for other in ("--json", "--coverage", "--follow"):
        assert refused("show", directory, other, "--markdown", "x.md").startswith("--markdown: expected RESULTS alone")
    assert "It can't be written" in refused("show", directory, "--markdown", tmp_path / "none" / "x.md")
