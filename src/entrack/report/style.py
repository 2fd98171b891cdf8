"""How trackers look: a letter, a colour and a dash that stay theirs throughout the report.

Plots are drawn in the light colours. In a page each colour becomes a CSS variable, which dark mode
sets to another one.
"""

import re
from dataclasses import dataclass
from html import escape
from string import ascii_uppercase

LIGHT = {
    "ink": "#1f2428",
    "quiet": "#656d76",
    "grid": "#d9dee4",
    "paper": "#ffffff",
    "s0": "#0a5fb4",
    "s1": "#c4480c",
    "s2": "#0b7a55",
    "s3": "#8a3a92",
    "s4": "#3f4650",
    "s5": "#b01648",
    "s6": "#8a6d00",
    "s7": "#1d8ca8",
}
DARK = {
    "ink": "#e6e9ec",
    "quiet": "#9aa4ae",
    "grid": "#363d45",
    "paper": "#15191d",
    "s0": "#6cb2ff",
    "s1": "#ff9a5c",
    "s2": "#4fd3a0",
    "s3": "#dc9fe6",
    "s4": "#c3cad2",
    "s5": "#ff8caa",
    "s6": "#e2c04a",
    "s7": "#5fd0ea",
}
_SERIES = sum(name[1:].isdecimal() for name in LIGHT)
_DASHES: tuple[tuple[float, ...], ...] = ((), (5, 2), (1.2, 1.4), (6, 1.6, 1.2, 1.6), (9, 3))


@dataclass(frozen=True)
class Style:
    """A tracker's looks.

    Parameters
    ----------
    letter
        "A" … "Z", "AA", …: what tells trackers apart in black and white.
    variable
        Name of its colour.
    dashes
        Lengths of dash and gap in line widths; empty for a solid line.
    """

    letter: str
    variable: str
    dashes: tuple[float, ...]

    @property
    def colour(self) -> str:
        """Its colour on white paper, "#rrggbb"."""
        return LIGHT[self.variable]

    @property
    def bgr(self) -> tuple[int, int, int]:
        """Its colour on pictures: the one for dark mode."""
        red, green, blue = bytes.fromhex(DARK[self.variable][1:])
        return blue, green, red


def styles(trackers: list[str]) -> dict[str, Style]:
    """Looks of each tracker, in order.

    >>> [style.letter for style in styles([str(i) for i in range(28)]).values()][-2:]
    ['AA', 'AB']
    """
    return {
        name: Style(_letter(i), f"s{i % _SERIES}", _DASHES[i % len(_DASHES)])
        for i, name in enumerate(dict.fromkeys(trackers))
    }


def _letter(number: int) -> str:
    before, last = divmod(number, len(ascii_uppercase))
    return (_letter(before - 1) if before else "") + ascii_uppercase[last]


def variables(colours: dict[str, str]) -> str:
    """Colours as CSS declarations."""
    return "".join(f"--{name}:{colour};" for name, colour in colours.items())


def inline_svg(svg: str, name: str, title: str) -> str:
    """Make a drawing a part of a page: it scales, adapts to dark mode, and its ids are its own."""
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r"<metadata>.*?</metadata>", "", svg, flags=re.DOTALL)
    svg = re.sub(r'(<svg[^>]*?) width="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'(<svg[^>]*?) height="[^"]*"', r"\1", svg, count=1)
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = svg.replace("url(#", f"url(#{name}-").replace('href="#', f'href="#{name}-')
    for variable, colour in LIGHT.items():
        svg = svg.replace(colour, f"var(--{variable})")
    label = f'<svg role="img" aria-label="{escape(title)}"'
    return svg.replace("<svg", label, 1)
