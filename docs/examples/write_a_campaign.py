"""Write a campaign file from Python, check it, and count what it would test."""

from pathlib import Path

import yaml

from vastflow import instantiate

campaign = {
    "version": 1,
    "configuration": [
        {
            "name": "radii",
            "parameters": [{"map_file": str(Path("campaigns/quickstart/maps/office.yaml").resolve())}],
            "variations": [
                {"PathVariationRandom": {"path_length": 4.0, "num_paths": 3, "robot_diameter": 0.5, "seed": 1}},
                {"ParameterVariationList": {"name": "robot_radius", "values": [0.2, 0.3]}},
            ],
        }
    ],
}
Path("radii.vast").write_text(yaml.safe_dump(campaign, sort_keys=False))
configurations = instantiate("radii.vast")
print(len(configurations.names), "configurations,", len(configurations.rejections), "rejected")
