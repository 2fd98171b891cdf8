"""Options that take several values at once: `--tracker cf opencv:csrt --out DIR`."""

from typing import Any

from typer.core import TyperCommand


class ManyValues(TyperCommand):
    """A command whose repeatable options also take several words, as if repeated for each."""

    def parse_args(self, ctx: Any, args: list[str]) -> list[str]:
        """Repeat the option before each further word, then parse as ever."""
        many = {name for p in self.params if getattr(p, "multiple", False) for name in p.opts}
        return super().parse_args(ctx, repeat(args, many))


def repeat(words: list[str], options: set[str]) -> list[str]:
    """Put the option before each further value of it.

    >>> repeat(["--tracker", "cf", "kcf", "--out", "DIR"], {"--tracker"})
    ['--tracker', 'cf', '--tracker', 'kcf', '--out', 'DIR']
    """
    repeated: list[str] = []
    option, first = "", False
    for word in words:
        if word.startswith("-"):
            option, first = word.partition("=")[0], "=" not in word
        elif option in options:
            repeated += [] if first else [option]
            first = False
        repeated.append(word)
    return repeated
