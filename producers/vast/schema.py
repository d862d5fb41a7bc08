"""The JSON Schema of campaign files, for editors."""

from pathlib import Path
from typing import Any, Final

from pydantic.json_schema import models_json_schema

from vastflow.producers.producer import find_producer, known_producers
from vastflow.producers.vast.spec import CampaignSpec

TITLE = "vastflow campaign file, version 1"
_PLACE: Final = "#/$defs/"


def campaign_schema() -> dict[str, Any]:
    """The schema of a `.vast` file (JSON Schema 2020-12), with the parameters of every installed producer."""
    producers = {name: find_producer(name, Path()) for name in known_producers()}
    models = {producer.Parameters: name for name, producer in producers.items()}
    references, definitions = models_json_schema(
        [(CampaignSpec, "validation"), *((model, "validation") for model in models)],
        ref_template=_PLACE + "{model}",
    )
    schemas: dict[str, Any] = dict(definitions.get("$defs", {}))
    variation = {
        "type": "object",
        "minProperties": 1,
        "maxProperties": 1,
        "properties": {
            name: {
                "anyOf": [references[producer.Parameters, "validation"], {"type": "null"}],
                "description": (producer.__doc__ or name).partition("\n")[0],
            }
            for name, producer in producers.items()
        },
        "patternProperties": {r"\.py:\w+$": {"type": ["object", "null"]}},
        "additionalProperties": False,
    }
    schemas["FamilySpec"]["properties"]["variations"]["items"] = variation
    campaign = schemas.pop("CampaignSpec")
    return {
        "$schema": "https://json-schema.org/draft/2020-12/schema",
        **campaign,
        "title": TITLE,
        "$defs": {name: schemas[name] for name in sorted(_named(campaign, schemas))},
    }


def _named(said: Any, schemas: dict[str, Any]) -> set[str]:
    """Names of the definitions that are referred to, from one to the next: pydantic also lists those of values that no file has."""
    found: set[str] = set()
    waiting = [said]
    while waiting:
        value = waiting.pop()
        if isinstance(value, dict):
            waiting += value.values()
            name = str(value.get("$ref", "")).removeprefix(_PLACE)
            if name in schemas and name not in found:
                found.add(name)
                waiting.append(schemas[name])
        elif isinstance(value, (list, tuple)):
            waiting += value
    return found
