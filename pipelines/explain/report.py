"""The story of a verdict as one HTML page that needs nothing else."""

import base64
import io
from pathlib import Path

from jinja2 import Environment

from metrology import write_text_whole
from mismatch import Explained, Verdict
from mismatch.table.explain import TableExplained
from pipelines.explain.plots import figure_of

__all__ = ["explain_report_html", "verdict_html", "write_explain_report"]

PAGE = """<!doctype html>
<html lang="en"><head><meta charset="utf-8"><title>What was left out</title>
<style>body{font:16px/1.5 system-ui,sans-serif;max-width:62rem;margin:2rem auto;padding:0 1rem}
table{border-collapse:collapse}td,th{border:1px solid #bbb;padding:.3em .7em;text-align:left}
img{max-width:100%}h1{font-size:1.6rem}</style></head><body>
<h1>{{ headline }}</h1>
<p>Baseline: {{ v.baseline_effects|join(", ") }}; chi² per degree of freedom
{{ "%.2f"|format(v.baseline_chi2_per_dof) }}.</p>
{% if v.location %}<h2>Where</h2><p>{{ v.location.statement }}</p>{% endif %}
{% if v.effects %}<h2>What</h2>
{% for e in v.effects %}<h3>{{ e.id }} (probability {{ "%.2f"|format(e.probability) }})</h3>
<p>{{ e.statement }}</p><table><tr><th>parameter</th><th>value</th><th>std</th><th>unit</th></tr>
{% for p in e.parameters %}<tr><td>{{ p.name }}</td><td>{{ "%.5g"|format(p.value) }}</td>
<td>{{ "%.2g"|format(p.std) }}</td><td>{{ p.unit }}</td></tr>{% endfor %}</table>{% endfor %}
{% endif %}
{% for group in v.indistinguishable %}
<p>The data can't tell apart: <b>{{ group|join(", ") }}</b>.</p>{% endfor %}
{% if v.next_measurement %}<p>What would settle it: {{ v.next_measurement }}.</p>{% endif %}
{% if v.held_out %}<h2>On data kept aside</h2>
<p>Trials {{ v.held_out.trials|join(", ") }}: root-mean-square error
{{ "%.3g"|format(v.held_out.rmse_before) }} {{ v.held_out.unit }} before,
{{ "%.3g"|format(v.held_out.rmse_after) }} {{ v.held_out.unit }} after;
ratio {{ "%.3g"|format(v.held_out.ratio_95[0]) }} to
{{ "%.3g"|format(v.held_out.ratio_95[1]) }} (95 %).</p>
{% endif %}
<h2>What remains</h2><p>{{ v.remainder.statement }}</p>
<img alt="residuals before and after, and the missing force" src="data:image/png;base64,{{ png }}">
{% if v.alternatives %}<h2>What else was tried</h2>
<table><tr><th>effects</th><th>why not</th><th>worse by</th></tr>
{% for a in v.alternatives %}<tr><td>{{ a.ids|join(" + ") }}</td><td>{{ a.why_not }}</td>
<td>{{ "%.1f"|format(a.delta_bic) }}</td></tr>{% endfor %}</table>{% endif %}
{% if v.notes %}<h2>About the data</h2><ul>{% for n in v.notes %}<li>{{ n }}</li>{% endfor %}</ul>
{% endif %}</body></html>
"""


CELL = """<div style="max-width:60rem"><p><b>{{ headline }}</b></p>
{% for line in lines %}<p>{{ line }}</p>{% endfor %}</div>"""


def verdict_html(verdict: Verdict) -> str:
    """The story in plain words as HTML for a notebook's cell."""
    headline, *lines = verdict.text().splitlines()
    return Environment(autoescape=True).from_string(CELL).render(headline=headline, lines=lines)


def explain_report_html(explained: Explained | TableExplained) -> str:
    """The page as text."""
    buffer = io.BytesIO()
    figure_of(explained).savefig(buffer, format="png", dpi=110)
    template = Environment(autoescape=True).from_string(PAGE)
    return template.render(
        v=explained.verdict,
        headline=explained.verdict.text().splitlines()[0],
        png=base64.b64encode(buffer.getvalue()).decode("ascii"),
    )


def write_explain_report(explained: Explained | TableExplained, path: Path) -> None:
    """Write the page."""
    write_text_whole(path, explain_report_html(explained))
