"""From sections to one offline HTML page."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from typing import Any

from analysis.charts import theme
from analysis.report.parts import Figure, Picture, Section

__all__ = ["render"]


def render(title: str, under: str, sections: Sequence[Section], footer: str) -> str:
    """Return the page; whatever came from a run folder is escaped.

    Args:
        title: the heading.
        under: a line below it.
        sections: in their order.
        footer: the last line.
    """
    import jinja2
    import vl_convert
    from markupsafe import Markup

    specs: list[dict[str, Any]] = []
    numbered = []
    for section in sections:
        parts = []
        for part in section.parts:
            shown: Any = part
            if isinstance(part, Figure):
                shown = replace(part, number=len(specs))
                specs.append(part.spec)
            elif isinstance(part, Picture):
                shown = replace(part, svg=Markup(part.svg))  # noqa: S704 - coevo.tree.draw escapes what is in it
            parts.append(shown)
        numbered.append(replace(section, parts=parts))
    folder = resources.files("analysis.report")
    files = {name: folder.joinpath(name).read_text(encoding="utf-8") for name in ("page.html", "parts.html")}
    environment = jinja2.Environment(
        loader=jinja2.DictLoader(files), autoescape=True, undefined=jinja2.StrictUndefined, trim_blocks=True
    )
    libraries = vl_convert.javascript_bundle()  # type: ignore[call-arg] # its stub does not know that nothing is needed
    bundle = libraries.replace("</script", "<\\/script").replace("<!--", "<\\!--")
    parts_module = environment.get_template("parts.html").module
    return environment.get_template("page.html").render(
        title=title,
        under=under,
        sections=numbered,
        figures=specs,
        looks={"light": theme(), "dark": theme(dark=True)},
        bundle=Markup(bundle),  # noqa: S704 - the libraries themselves
        footer=footer,
        show=parts_module.show,  # type: ignore[attr-defined]
    )
