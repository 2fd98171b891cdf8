"""Write the shipped model folders from the presets, after a trunk or a preset has changed.

python scripts/make_models.py
"""

import tomllib
from typing import NamedTuple

from entrack.config import Config, parse
from entrack.model import SHIPPED, assets, save_model


class Recipe(NamedTuple):
    """What a model is made of, besides the trunk."""

    description: str
    preset: str
    """File of the configuration; that of a training has it as [tracker]."""
    policy: str | None = None
    """The model in whose folder the weights are."""


RECIPES = {
    "default": Recipe(
        "What `entrack track` uses: the filter of cf and a learned policy, eqs. 1-7 and 14.",
        "default", "policy",
    ),
    "policy": Recipe("The same as default, by its older name.", "default", "policy"),
    "longterm": Recipe(
        "The model default, and a search for a target that is lost.", "longterm", "policy"
    ),
    "cf": Recipe("The correlation filter with three sizes, eqs. 1-3 and 14.", "cf"),
    "quick": Recipe(
        "The filter of cf with few passes of the trunk on smaller patches, for many objects.",
        "quick",
    ),
    "paper": Recipe(
        "The paper as printed, trained to the end: it does not follow. Compare with it.",
        "train-paper", "paper",
    ),
    "cf-baseline": Recipe(
        "The paper's CF.Baseline: the correlation filter, the size stays.", "cf-baseline"
    ),
}  # fmt: skip


def main() -> None:
    models, trunk = assets() / "models", assets() / "trunk" / "trunk.onnx"
    for name in SHIPPED:
        description, preset, weights = RECIPES[name]
        path = assets().parent / "presets" / f"{preset}.toml"
        content = tomllib.loads(path.read_text())
        config = parse(Config, content.get("tracker", content), str(path))
        policy = models / weights / "policy.safetensors" if weights else None
        save_model(models / name, name, description, config, trunk, policy)
        print(f"wrote {models / name / 'model.toml'}")


if __name__ == "__main__":
    main()
