"""The page on operation: what it tells Prefect is what Prefect takes, and its figures stand for what is there."""

import re
from pathlib import Path

import yaml
from prefect.events.schemas.automations import AutomationCore
from prefect.settings import Settings
from prefect.settings.legacy import _get_valid_setting_names
from table import each_row
from typer.main import get_command

from vastflow.flows.cli.__main__ import app

PAGE = (Path(__file__).parents[2] / "docs" / "operate.md").read_text()
AUTOMATIONS = [
    each
    for block in re.findall(r"^```yaml\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    for each in yaml.safe_load(block)["automations"]
]


@each_row("written", AUTOMATIONS)
def test_documented_automation_is_accepted_by_prefect(written):
    automation = AutomationCore.model_validate(written)
    assert (automation.enabled, automation.trigger.threshold) == (True, 1)


def test_settings_of_the_page_are_known_to_prefect():
    named = set(re.findall(r"PREFECT_[A-Z_]+[A-Z]", PAGE))
    assert named - _get_valid_setting_names(Settings) == set()
    assert len(named) > 8


def test_commands_of_the_page_exist():
    group = get_command(app)
    named = set(re.findall(r"`vastflow ((?:store |bench )?[a-z]+)\b", PAGE))
    named |= set(re.findall(r"^vastflow ((?:store )?[a-z]+)", PAGE, re.MULTILINE))
    for words in map(str.split, named):
        command = group
        for word in words:
            assert word in command.commands, words
            command = command.commands[word]
