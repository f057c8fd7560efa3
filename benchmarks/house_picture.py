"""Picture of the shelves for CONTRIBUTING.md, from the import contracts in pyproject.toml.

python benchmarks/house_picture.py
"""

import textwrap
import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[1]
WIDTH = 74


def layers(name: str) -> list[str]:
    """Layers of a contract, from top to bottom, without the signs of the contract."""
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"][
        "contracts"
    ]
    contract = next(contract for contract in contracts if contract["name"] == name)
    return [
        layer.replace("(", "").replace(")", "").replace(" | ", ", ") for layer in contract["layers"]
    ]


def floor(text: str, indent: str = "") -> list[str]:
    """Lines of one layer."""
    return [f"| {indent}{line:<{WIDTH - len(indent)}} |" for line in textwrap.wrap(text, WIDTH - 4)]


def picture() -> str:
    """Shelves from top to bottom; each may import those below it."""
    edge = f"+{'-' * (WIDTH + 2)}+"
    lines = [edge]
    for layer in layers("Data flows one way"):
        lines += floor(layer)
        if layer == "apps":
            for application in layers("Applications in layers"):
                lines += floor(application, "  ")
        lines.append(edge)
    return "\n".join(lines)


if __name__ == "__main__":
    print(picture())
