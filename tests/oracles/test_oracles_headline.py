"""The headline of a campaign in a notebook."""

import re
from html.parser import HTMLParser

from vastflow.flows.results.summary import Results
from vastflow.oracles.page.headline import headline_html
from vastflow.oracles.page.report import write_report

TASK = {"start_pose": {"x": 1.0, "y": 2.0}, "goal_pose": {"x": 5.0, "y": 2.0}}
ALONG = [(1.0 + 0.1 * k, 2.0) for k in range(41)]


class Tags(HTMLParser):
    def __init__(self, page):
        super().__init__()
        self.open, self.images, self.text = [], [], ""
        self.feed(page)

    def handle_starttag(self, tag, attrs):
        if tag == "img":
            self.images.append(dict(attrs)["src"])
        else:
            self.open.append(tag)

    def handle_endtag(self, tag):
        assert self.open.pop() == tag

    def handle_data(self, data):
        self.text += data


def test_results_show_their_headline_causes_and_figures(synthetic_campaign, tmp_path, build):
    room = build.write_map(tmp_path / "room", build.walled_room(6.0, 4.0))
    failed = build.a_recording(ALONG[:20], run_index=1, outcome="aborted", error_xy_m=(0.0, 0.8))
    synthetic_campaign.add("a-1", "a", room, TASK, recordings=[build.a_recording(ALONG), failed])
    directory = synthetic_campaign.write()
    write_report(directory)
    html = Results(directory, None, (), ())._repr_html_()
    page = Tags(html)
    assert page.open == []
    assert "50\N{NO-BREAK SPACE}% of the judged runs passed: 1 of 2, 0 not judged overall." in page.text
    assert "Lost" in page.text and "vastflow replay . a-1 1" in page.text
    assert len(page.images) == 2 and all(image.startswith("data:image/png;base64,") for image in page.images)
    assert not re.search(r"<script|https?://", html)
    assert html == headline_html(directory)


def test_results_whose_directory_is_gone_have_no_html_so_that_a_notebook_shows_their_repr(tmp_path):
    assert Results(tmp_path / "gone", None, (), ())._repr_html_() is None
