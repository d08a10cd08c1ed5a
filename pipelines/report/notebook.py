"""Results as a small piece of HTML, for a notebook's cell."""

import base64
import io
from collections.abc import Sequence

from jinja2 import Environment, StrictUndefined
from PIL import Image

from metrology import Quantity
from pipelines.report.inputs import quantity_label, quantity_text

__all__ = ["results_html"]

_CELL = """<div style="max-width:60rem">
{% if title %}<div><b>{{ title }}</b></div>{% endif %}
{% for warning in warnings %}<div style="border-left:4px solid #b03a00;padding:.1rem .6rem;
margin:.2rem 0">{{ warning }}</div>{% endfor %}
{% if still %}<img alt="a frame with ball, pendulum and path drawn into it"
src="data:image/jpeg;base64,{{ still }}" style="max-width:100%;margin:.4rem 0">{% endif %}
<table><thead><tr><th style="text-align:left">quantity</th>
<th style="text-align:left">value ± standard uncertainty</th></tr></thead><tbody>
{% for label, value, known in rows %}<tr><td style="text-align:left">{{ label }}</td>
<td style="text-align:left">{% if known %}{{ value }}{% else %}<i>{{ value }}</i>{% endif %}</td>
</tr>{% endfor %}</tbody></table></div>"""


def results_html(
    title: str,
    quantities: Sequence[Quantity],
    warnings: Sequence[str] = (),
    still_png: bytes | None = None,
) -> str:
    """Table of results, warnings above it, and a picture where there is one.

    Parameters
    ----------
    title : str
    quantities : sequence of Quantity
    warnings : sequence of str
    still_png : bytes, optional
        A frame of the clip.

    Returns
    -------
    str
        HTML; every text in it is escaped.
    """
    rows = [(quantity_label(q.name), quantity_text(q), q.value is not None) for q in quantities]
    still = None if still_png is None else base64.b64encode(_as_jpeg(still_png)).decode("ascii")
    template = Environment(autoescape=True, undefined=StrictUndefined).from_string(_CELL)
    return template.render(title=title, rows=rows, warnings=warnings, still=still)


def _as_jpeg(png: bytes) -> bytes:
    """A seventh of the size: a notebook keeps every picture it has shown."""
    buffer = io.BytesIO()
    Image.open(io.BytesIO(png)).convert("RGB").save(buffer, format="JPEG", quality=85)
    return buffer.getvalue()
