"""The page: everything in one HTML file, which asks nobody for anything."""

import base64
from importlib.resources import files

from jinja2 import Environment, FunctionLoader
from markupsafe import Markup

import entrack
from entrack.report import formats, metrics, style
from entrack.report.chapters import Chapter
from entrack.report.figures import Plot
from entrack.report.style import Style
from entrack.report.table import Table


def render(chapters: list[Chapter], references: list[Table], styles: dict[str, Style]) -> str:
    """Return the page's HTML."""

    def inline(plot: Plot) -> Markup:
        return Markup(style.inline_svg(plot.svg, plot.name, plot.title))

    def template(name: str) -> str:
        return (files("entrack.report") / "templates" / name).read_text("utf-8")

    environment = Environment(
        loader=FunctionLoader(template), autoescape=True, trim_blocks=True, lstrip_blocks=True
    )
    return environment.get_template("page.html").render(
        chapters=chapters,
        references=references,
        styles=styles,
        texts=formats.texts,
        inline=inline,
        data_uri=data_uri,
        meaning=metrics.meaning,
        light=Markup(style.variables(style.LIGHT)),
        dark=Markup(style.variables(style.DARK)),
        css=Markup(template("page.css")),
        script=Markup(template("sort.js")),
        version=entrack.__version__,
    )


def data_uri(content: str | bytes, kind: str) -> str:
    """Content as a link that holds it.

    >>> data_uri("a", "text/csv")
    'data:text/csv;base64,YQ=='
    """
    data = content.encode() if isinstance(content, str) else content
    return f"data:{kind};base64,{base64.b64encode(data).decode()}"
