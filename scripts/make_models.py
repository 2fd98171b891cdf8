"""Write the shipped model folders from the presets, after a trunk or a preset has changed.

python scripts/make_models.py
"""

import tomllib

from entrack.config import Config, parse, read
from entrack.model import SHIPPED, assets, save_model

DESCRIPTIONS = {
    "default": "What `entrack track` uses: the filter of cf and a learned policy, eqs. 1-7 and 14.",
    "policy": "The same as default, by its older name.",
    "longterm": "The model default, and a search for a target that is lost.",
    "cf": "The correlation filter with three sizes, eqs. 1-3 and 14.",
    "quick": "The filter of cf with few passes of the trunk on smaller patches, for many objects.",
    "paper": "The paper as printed, trained to the end: it does not follow. Compare with it.",
    "cf-baseline": "The paper's CF.Baseline: the correlation filter, the size stays.",
}


def main() -> None:
    presets = assets().parent / "presets"
    for name in SHIPPED:
        folder, weights = assets() / "models" / name, "paper" if name == "paper" else "policy"
        if name == "paper":  # whose presets/paper.toml is for an imported trunk, without a policy
            trained = presets / "train-paper.toml"
            config = parse(Config, tomllib.loads(trained.read_text())["tracker"], str(trained))
        else:
            config = read(Config, presets / f"{'default' if name == 'policy' else name}.toml")
        policy = assets() / "models" / weights / "policy.safetensors" if config.policy else None
        trunk = assets() / "trunk" / "trunk.onnx"
        save_model(folder, name, DESCRIPTIONS[name], config, trunk, policy)
        print(f"wrote {folder / 'model.toml'}")


if __name__ == "__main__":
    main()
