"""The page of a diagnosis: one self-contained document, without scripts and without requests to anywhere."""

DIAGNOSIS_PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light">
<title>{{ title }}</title>
<style>
:root {
  --ink: #1d2127; --soft: #59616c; --rule: #e2e4e7; --tint: #f4f5f6; --card: #ffffff;
  --data: #c85a00; --base: #1c63b7; --cause: #1d2127; --floor: #8a6d00; --accent: #1c63b7;
}
* { box-sizing: border-box; }
body {
  margin: 0; background: #fbfbfa; color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
  print-color-adjust: exact; -webkit-print-color-adjust: exact;
}
main { max-width: 1000px; margin: 0 auto; padding: 1.8rem 1.25rem 3.5rem; overflow-wrap: anywhere; }
h1 { font-size: 1.05rem; font-weight: 600; margin: 0 0 .6rem; color: var(--soft); }
h2 { font-size: 1.25rem; line-height: 1.3; margin: 2.6rem 0 .3rem; break-after: avoid; }
h3 { font-size: .95rem; margin: 0 0 .35rem; break-after: avoid; }
p { margin: .3rem 0 .7rem; max-width: 78ch; }
.soft, figcaption, .facts, small { color: var(--soft); font-size: .86rem; }
.verdict {
  background: var(--card); border: 1px solid var(--rule); border-left: 8px solid var(--accent); border-radius: 8px;
  padding: 1rem 1.3rem;
}
.verdict.none { --accent: #00727f; } .verdict.ambiguous { --accent: #b07d00; } .verdict.unknown { --accent: #7b4397; }
.verdict strong { display: block; font-size: .85rem; letter-spacing: .04em; text-transform: uppercase;
  color: var(--accent); }
.verdict .sentence { font-size: 1.4rem; line-height: 1.3; margin: .15rem 0 .4rem; max-width: none; }
.verdict p { margin-bottom: 0; }
.verdict dl { display: flex; flex-wrap: wrap; gap: .5rem 2.4rem; margin: .7rem 0 .6rem; }
.verdict dt { font-size: .8rem; color: var(--soft); } .verdict dd { margin: 0; font-size: 1.15rem; font-weight: 600; }
.verdict small { font-weight: 400; }
.card { background: var(--card); border: 1px solid var(--rule); border-radius: 8px; padding: .9rem 1.1rem;
  margin: .8rem 0; overflow-x: auto; }
figure { margin: 0; min-width: 0; break-inside: avoid; } figcaption { margin-top: .3rem; }
.two { display: grid; grid-template-columns: minmax(0, 1fr) minmax(0, 1fr); gap: .8rem 1.4rem; align-items: start; }
.three { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)); gap: .8rem 1.2rem; align-items: start; }
.card > p:last-child { margin-bottom: 0; } .two .card { margin: 0; } .stack { display: grid; gap: .8rem; }
.graph { display: block; width: 100%; height: auto; }
@media (max-width: 720px) {
  .two, .three { grid-template-columns: minmax(0, 1fr); } .graph.wide { min-width: 40rem; }
}
.graph text { fill: var(--ink); font-size: 13px; } .graph .small { font-size: 12.5px; }
.graph .tick { fill: var(--soft); font-size: 11.5px; } .graph .value { font-variant-numeric: tabular-nums; }
.graph .middle { text-anchor: middle; } .graph .end { text-anchor: end; }
.graph .axis, .scores .axis { stroke: var(--soft); } .graph .grid { stroke: var(--rule); }
.graph .level { stroke: var(--soft); stroke-dasharray: 2 4; }
.graph rect.data { fill: var(--data); } rect.base { fill: var(--base); } rect.cause { fill: var(--cause); }
rect.floored { fill: var(--floor); } rect.pale { fill: #9db4d3; } rect.track { fill: #eceef0; }
rect.score { fill: var(--base); }
.graph line.floor { stroke: var(--floor); stroke-width: 2.5; }
.graph .whisker { stroke: var(--data); stroke-width: 2.5; } .graph .halo { stroke: #fff; stroke-width: 6; }
.graph .line { fill: none; stroke-width: 2; stroke-linejoin: round; }
.graph .line.data { stroke: var(--data); stroke-width: 2.6; }
.graph .line.base { stroke: var(--base); stroke-dasharray: 6 3; } .graph .line.effect { stroke: var(--cause); }
.graph .line.thin { stroke-width: 1; stroke-dasharray: none; opacity: .5; }
.graph .band { fill: #c85a0024; } .graph .line.filled { fill: #c85a0018; }
.graph circle { fill: none; } .graph .plate { stroke: var(--soft); stroke-dasharray: 4 4; fill: var(--tint); }
.graph .flat { stroke: var(--rule); } .graph .edge { stroke: var(--soft); }
.graph .cells path { stroke: #fff; stroke-width: 1; }
.graph .region { fill: none; stroke: var(--data); stroke-width: 3.5; stroke-linejoin: round; }
.graph .arrow { stroke: var(--data); stroke-width: 3.5; } .graph .head { fill: var(--data); }
.map { max-width: 25rem; margin: 0 auto; }
.share { display: block; width: 100%; height: .8rem; } .scores { width: 120px; height: 12px; display: block; }
.key { display: inline-block; width: 1.7em; height: 0; border-top: 3px solid; vertical-align: middle;
  margin: 0 .3em 0 .6em; }
.key.data { color: var(--data); } .key.base { color: var(--base); border-top-style: dashed; }
.key.effect { color: var(--cause); } .key.band { border-top-width: .8em; color: #c85a0030; }
.key.floor { color: var(--floor); width: 0; height: 1em; border-top: 0; border-left: 3px solid; }
.cause { border-top: 1px solid var(--rule); padding: .7rem 0; break-inside: avoid; }
td.bars { width: 130px; }
.cause:first-child { border-top: 0; padding-top: .1rem; } .cause:last-child { padding-bottom: .1rem; }
.cause .row {
  display: grid; grid-template-columns: minmax(0, 17rem) minmax(0, 1fr) 4rem; gap: 1rem; align-items: center;
}
.cause .row b { font-size: 1.02rem; } .cause .row .soft { display: block; }
.cause .share-of { text-align: right; font-variant-numeric: tabular-nums; font-weight: 600; }
.cause p { margin: .3rem 0 0; } .cause ul { margin: .3rem 0 0; padding-left: 1.1rem; }
@media (max-width: 720px) {
  .cause .row { grid-template-columns: minmax(0, 1fr) 4rem; } .cause .row .share { grid-row: 2; grid-column: 1 / -1; }
  td.bars { display: none; }
}
.chip { font-size: .78rem; color: var(--soft); border: 1px solid var(--rule); border-radius: 99px; padding: 0 .55rem;
  white-space: nowrap; }
.chip.in { border-color: var(--base); color: var(--base); }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; width: 100%; }
caption { text-align: left; color: var(--soft); font-size: .86rem; padding-bottom: .4rem; }
th, td { padding: .3rem .5rem; text-align: right; border-bottom: 1px solid var(--rule); overflow-wrap: normal; }
th { font-weight: 600; vertical-align: bottom; } th.left, td.left { text-align: left; overflow-wrap: break-word; }
ol.next { padding-left: 2.2rem; } ol.next li { margin: .35rem 0; padding-left: .2rem; break-inside: avoid; }
ol.next small { display: block; }
.facts { display: grid; grid-template-columns: max-content 1fr; gap: .15rem 1rem; margin: .5rem 0; }
.facts dt { font-weight: 600; } .facts dd { margin: 0; }
.empty { color: var(--soft); font-style: italic; }
@page { margin: 14mm; }
@media print {
  html { font-size: 12px; } body { background: #fff; font-size: 12px; } main { padding: 0; max-width: none; }
  .card { break-inside: avoid; } .card.long { break-inside: auto; }
}
</style>
</head>
<body>
<main>
<h1>Drape diagnosis: {{ fabric }}</h1>
<section class="verdict {{ verdict.style }}" aria-label="Verdict">
<strong>{{ verdict.name }}</strong>
<p class="sentence">{{ verdict.sentence }}</p>
{% if verdict.facts %}<dl>{% for name, value, of in verdict.facts %}
<div><dt>{{ name }}</dt><dd>{{ value }} <small>{{ of }}</small></dd></div>{% endfor %}</dl>{% endif %}
<p class="soft">{{ verdict.data }}</p>
</section>

<h2>Does simulation differ from the data?</h2>
<p>{{ gap.words }} {{ gap.chance }}</p>
{% if gap.graph %}
<figure class="card">{{ gap.graph }}
<figcaption>The gap compares all statistics of unseen samples with as many simulated ones.{% if gap.floor %}
 <span class="key floor"></span>floor: what two halves of the data differ by; no model can do better.{% endif %}
{% if gap.below %} Estimates without bias can fall a little below 0.{% endif %}
</figcaption></figure>
{% endif %}

<h2>Where does it lie?</h2>
<p>{{ where.words }}</p>
<div class="two">
<figure class="card">
<h3>On the cloth</h3>
{{ where.map }}
<figcaption>{{ where.caption }}</figcaption></figure>
<div class="stack">
<figure class="card"><h3>In what is measured</h3>
{% if where.groups %}{{ where.groups }}
<figcaption>Gap of the base model by kind of statistic.{% if where.floors %}
 <span class="key floor"></span>floor{% endif %}
</figcaption>{% else %}<p class="empty">Not known: no drapes were simulated.</p>{% endif %}</figure>
<figure class="card"><h3>In the making of a drape</h3>
{% if where.stages %}{{ where.stages }}
<figcaption>Probability that the cause is one of this stage.</figcaption>
{% else %}<p class="empty">Not known.</p>{% endif %}</figure>
</div>
</div>

<h2>What causes it?</h2>
{% if causes.shown %}
<div class="card long">
{% for cause in causes.shown %}
<article class="cause">
<div class="row"><div><b>{{ cause.name }}</b>{% if cause.kind %} <span class="chip">{{ cause.kind }}</span>{% endif %}
<span class="soft">{{ cause.summary }}</span></div>
{{ cause.bar }}<div class="share-of">{{ cause.probability }}</div></div>
{% if cause.chips %}<p>{% for chip in cause.chips %}<span class="chip in">{{ chip }}</span> {% endfor %}</p>{% endif %}
{% if cause.parameters %}<ul class="soft">{% for name, value, meaning in cause.parameters %}
<li><b>{{ name }} {{ value }}</b>{% if meaning %}: {{ meaning }}{% endif %}</li>{% endfor %}</ul>{% endif %}
{% if cause.signature %}<p class="soft"><b>Would show:</b> {{ cause.signature }}</p>{% endif %}
{% if cause.physics %}<p class="soft"><b>Does:</b> {{ cause.physics }}</p>{% endif %}
</article>
{% endfor %}
</div>
<p class="soft">{{ causes.rest }}</p>
{% else %}<p class="empty">No causes were weighed.</p>{% endif %}
{% if statistics.rows %}
<div class="card">
<table>
<caption>What differs most from the base model{{ statistics.with_cause }}.
 z is data minus base model in standard errors; cosine and sine are of m times the angle from warp.</caption>
<thead><tr><th class="left">statistic</th><th>unit</th>
{% if statistics.up %}<th>face up</th>{% endif %}{% if statistics.down %}<th>face down</th>{% endif %}
<th>base model</th>{% if statistics.with_cause %}<th>with cause</th>{% endif %}<th>z</th><td></td></tr></thead>
<tbody>{% for row in statistics.rows %}
<tr><td class="left">{{ row.name }}</td><td>{{ row.unit }}</td>
{% if statistics.up %}<td>{{ row.up }}</td>{% endif %}{% if statistics.down %}<td>{{ row.down }}</td>{% endif %}
<td>{{ row.base }}</td>{% if statistics.with_cause %}<td>{{ row.effect }}</td>{% endif %}
<td>{{ row.z }}</td><td class="bars">{{ row.bar }}</td></tr>
{% endfor %}</tbody>
</table>
</div>
{% endif %}

<h2>Before and after</h2>
{% if profiles.means %}
<p>{{ profiles.words }}</p>
<p class="soft">{{ profiles.key }}</p>
<div class="card">
<div class="two">{% for name, graph in profiles.means %}
<figure><h3>{{ name }}</h3>{{ graph }}</figure>{% endfor %}</div>
<p class="soft">Mean outline with the folds smoothed out (at most {{ profiles.modes }} waves around). Folds fall
 elsewhere in every sample; what is left belongs to the cloth and how it lies: stiff directions, weak places,
 a cloth off centre.
{% if profiles.band %}<span class="key band"></span>range of the data's samples{% endif %}</p>
</div>
<div class="card">
<div class="three">{% for name, graph in profiles.every %}
<figure><h3>{{ name }}</h3>{{ graph }}</figure>{% endfor %}</div>
<p class="soft">Every drape, {{ profiles.faces }}. Compare number, depth and regularity of folds, not their places.
 Dotted: radius of the plate and of the flat cloth.</p>
</div>
<div class="card">
<div class="three">{% for name, graph in profiles.outlines %}
<figure><h3>{{ name }}</h3>{{ graph }}</figure>{% endfor %}</div>
<p class="soft">Silhouettes: of each source one drape of middling size, from above, in the cloth's frame.
{{ profiles.damaged }}</p>
</div>
{% else %}<p class="empty">No profiles to show: {{ profiles.why }}.</p>{% endif %}

<h2>How far does the gap shrink?</h2>
<p>{{ closure.words }}</p>
{% if closure.graph %}<figure class="card">{{ closure.graph }}
<figcaption>Closed share of the gap above its floor{{ closure.interval }}.</figcaption></figure>{% endif %}

{% if steps.rows %}
<div class="card">
<h3>What else the fabric needs</h3>
<p class="soft">{{ steps.words }}</p>
<table>
<thead><tr><th class="left">cause</th><th class="left">parameters</th><th>misfit left</th></tr></thead>
<tbody>{% for name, parameters, misfit in steps.rows %}
<tr><td class="left">{{ name }}</td><td class="left">{{ parameters }}</td><td>{{ misfit }}</td></tr>
{% endfor %}</tbody></table>
<p class="soft">Misfit: mean square of what is left, in standard errors; 1 where all is explained.</p>
</div>
{% endif %}

<h2>What to measure next</h2>
{% if next %}
<ol class="next card">{% for step in next %}
<li><b>{{ step.name }}</b>: {{ step.what }}
<small>{{ step.worth }}{% if step.about %}; speaks about {{ step.about }}{% endif %}</small></li>{% endfor %}</ol>
{% else %}<p class="empty">{{ no_next }}</p>{% endif %}

<h2>What cannot be told apart</h2>
{% if indistinguishable %}
<ul>{% for group in indistinguishable %}
<li><b>{{ group.effects }}</b>{% if group.why %}: {{ group.why }}{% endif %}</li>
{% endfor %}</ul>
{% else %}<p class="empty">{{ told_apart }}</p>{% endif %}
{% if without %}<p>Not considered: {{ without }}.</p>{% endif %}
{% if notes %}
<h3>Notes</h3>
<ul>{% for note in notes %}<li>{{ note }}</li>{% endfor %}</ul>
{% endif %}

<h2>The cloth as the base model sees it</h2>
{% if cloth %}
<div class="card"><table>
<thead><tr><th class="left">quantity</th><th>value</th><th class="left">meaning</th></tr></thead><tbody>
{% for name, value, meaning in cloth %}
<tr><td class="left">{{ name }}</td><td>{{ value }}</td><td class="left">{{ meaning }}</td></tr>
{% endfor %}</tbody></table>
<p class="soft">ρ mass per area, g gravity, R radius of the cloth. Fitted without any cause.</p></div>
{% else %}<p class="empty">Not known.</p>{% endif %}
{% if made %}<dl class="facts">{% for name, value in made %}
<dt>{{ name }}</dt><dd>{{ value }}</dd>{% endfor %}</dl>{% endif %}
</main>
</body>
</html>
"""
