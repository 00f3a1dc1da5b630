"""What notebooks show of an object."""

from __future__ import annotations

import base64
from html import escape
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from ._dsfms import Template


def template(template: Template) -> str:
    """A table and the albedo of a template."""
    rows = {
        "vertices": len(template.vertices),
        "faces": len(template.faces),
        "unit": template.unit,
        "views": len(template.poses),
        "sparse points": len(template.points),
        "descriptors": template.feature_count,
    }
    cells = "".join(
        f"<tr><th style='text-align:left'>{escape(name)}</th><td>{escape(str(value))}</td></tr>"
        for name, value in rows.items()
    )
    png = template.albedo_png(256)
    picture = ""
    if png is not None:
        data = base64.b64encode(png).decode()
        picture = f"<img alt='albedo' width='256' src='data:image/png;base64,{data}'>"
    return (
        "<div style='display:flex;gap:1em;align-items:center'>"
        f"<table><caption>dsfms.Template</caption>{cells}</table>{picture}</div>"
    )
