"""The report's page: one self-contained document, without scripts and without requests to anywhere."""

PAGE = """<!doctype html>
<html lang="en">
<head>
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<meta name="color-scheme" content="light dark">
<title>{{ title }}</title>
<style>
:root {
  --page: #fbfbfa; --card: #ffffff; --ink: #1d2127; --soft: #626a75; --rule: #e2e4e7; --tint: #f3f4f5;
  --real: #c85a00; --simulated: #1c63b7; --band: #c85a0026; --null: #8a6d00; --oracle: #8b3fa8; --floor: #00727f;
}
@media (prefers-color-scheme: dark) {
  :root {
    --page: #14161a; --card: #1b1e23; --ink: #e6e8eb; --soft: #9aa3af; --rule: #2f343b; --tint: #22262c;
    --real: #ff9440; --simulated: #6aaaf5; --band: #ff944030; --null: #e0bd4a; --oracle: #d295ea; --floor: #52c5d1;
  }
}
* { box-sizing: border-box; }
body {
  margin: 0; background: var(--page); color: var(--ink);
  font: 16px/1.5 system-ui, -apple-system, "Segoe UI", Roboto, "Helvetica Neue", Arial, sans-serif;
}
main { max-width: 1180px; margin: 0 auto; padding: 2rem 1.25rem 4rem; }
h1 { font-size: 1.7rem; line-height: 1.2; margin: 0 0 .3rem; letter-spacing: -.01em; }
h2 { font-size: 1.25rem; margin: 3rem 0 .2rem; }
h3 { font-size: 1rem; margin: 0; overflow-wrap: anywhere; }
p { margin: .3rem 0 .8rem; max-width: 75ch; }
.soft, .facts, figcaption, .notes, caption { color: var(--soft); font-size: .85rem; }
.facts { margin: 0 0 1.5rem; display: grid; grid-template-columns: max-content 1fr; gap: .15rem 1rem; }
.facts dt { font-weight: 600; } .facts dd { margin: 0; overflow-wrap: anywhere; }
.scroll { overflow-x: auto; margin: 1rem -1.25rem; padding: 0 1.25rem; }
table { border-collapse: collapse; font-size: .86rem; font-variant-numeric: tabular-nums; width: 100%; }
caption { text-align: left; padding-bottom: .5rem; }
th, td { padding: .35rem .6rem; text-align: right; white-space: nowrap; border-bottom: 1px solid var(--rule); }
th { vertical-align: bottom; font-weight: 600; } th small { display: block; font-weight: 400; color: var(--soft); }
th.left, td.left { text-align: left; }
tr.null td.left { color: var(--null); } tr.oracle td.left { color: var(--oracle); }
tr.floor td.left { color: var(--floor); } tr.solver td { font-weight: 600; background: var(--tint); }
.notes { padding-left: 1.1rem; } .notes li { margin: .15rem 0; overflow-wrap: anywhere; }
nav { display: flex; flex-wrap: wrap; gap: .4rem .9rem; font-size: .9rem; }
a { color: var(--simulated); }
.card {
  background: var(--card); border: 1px solid var(--rule); border-radius: 10px; padding: 1rem 1.1rem; margin: 1rem 0;
}
.card header { display: flex; flex-wrap: wrap; align-items: baseline; gap: .2rem .8rem; }
.kind { font-size: .78rem; color: var(--soft); border: 1px solid var(--rule); border-radius: 99px; padding: 0 .55rem; }
.numbers { display: flex; flex-wrap: wrap; gap: .4rem 1.6rem; margin: .6rem 0 .8rem; }
.numbers div { min-width: 4.5rem; } .numbers dt { font-size: .76rem; color: var(--soft); }
.numbers dd { margin: 0; font-variant-numeric: tabular-nums; }
.numbers .of { color: var(--soft); font-size: .85rem; }
.pictures { display: grid; grid-template-columns: repeat(3, minmax(0, 1fr)) minmax(0, 1.65fr); gap: .8rem; }
.graphs { display: grid; grid-template-columns: minmax(0, 1.35fr) minmax(0, 1fr); gap: .8rem; margin-top: .8rem; }
@media (max-width: 820px) { .pictures { grid-template-columns: repeat(3, minmax(0, 1fr)); }
  .pictures .wide { grid-column: 1 / -1; } .graphs { grid-template-columns: minmax(0, 1fr); } }
figure { margin: 0; min-width: 0; }
figure .frame { position: relative; background: var(--tint); border-radius: 6px; overflow: hidden; }
figure img { display: block; width: 100%; height: auto; }
.frame.square::after {
  /* the plate: 9 cm of a picture that shows 17.7 cm to each side */
  content: ""; position: absolute; inset: 24.6%; border: 1px dashed var(--soft); border-radius: 50%; opacity: .8;
}
figure.wide .frame {
  aspect-ratio: 64 / 42; height: calc(100% - 1.6rem); width: 100%; display: grid; place-items: center;
}
figure.wide img { width: auto; max-width: 100%; max-height: 100%; }
.draws img { max-width: 24rem; margin: 0 auto; } figcaption { margin-top: .25rem; }
.cloth { display: grid; grid-template-columns: minmax(0, 20rem) minmax(0, 1fr); gap: 1.2rem; align-items: center; }
@media (max-width: 620px) { .cloth { grid-template-columns: minmax(0, 1fr); } }
.graph { display: block; width: 100%; height: auto; }
.graph .axis { stroke: var(--soft); } .graph .grid { stroke: var(--rule); }
.graph .level { stroke: var(--soft); stroke-dasharray: 3 4; }
.graph .tick { fill: var(--soft); font-size: 11px; }
.graph .middle { text-anchor: middle; } .graph .end { text-anchor: end; }
.graph .line { fill: none; stroke-width: 2; stroke-linejoin: round; }
.graph .real { stroke: var(--real); } .graph .simulated { stroke: var(--simulated); }
.graph .band { fill: var(--band); stroke: none; }
.key {
  display: inline-block; width: 1.1em; height: 0; border-top: 3px solid; vertical-align: middle; margin-right: .2em;
}
.key.real { color: var(--real); } .key.simulated { color: var(--simulated); }
.key.band { border-top-width: .7em; color: var(--band); }
.swatch { display: inline-block; width: .75em; height: .75em; border-radius: 2px; vertical-align: -.05em; }
.empty { color: var(--soft); font-style: italic; }
@media print { body { background: #fff; } .card { break-inside: avoid; } }
</style>
</head>
<body>
<main>
<h1>{{ title }}</h1>
<p class="soft">{{ summary }}</p>
<dl class="facts">
{% for name, value in facts %}<dt>{{ name }}</dt><dd>{{ value }}</dd>
{% endfor %}</dl>
{% for board in boards %}
<div class="scroll" role="region" aria-label="Leaderboard" tabindex="0">{{ board.table }}</div>
<ul class="notes">{% for note in board.notes %}<li>{{ note }}</li>{% endfor %}</ul>
{% endfor %}
<nav aria-label="Cloths">{% for cloth in cloths %}<a href="#{{ cloth.anchor }}">{{ cloth.name }}</a>{% endfor %}</nav>
{% for cloth in cloths %}
<section id="{{ cloth.anchor }}">
<h2>{{ cloth.name }}</h2>
{% if cloth.real %}
<div class="cloth">
<figure><div class="frame"><img src="{{ cloth.real.source }}" alt="{{ cloth.real.alt }}" width="640" height="420"
 loading="lazy"></div><figcaption>{{ cloth.real.caption }}</figcaption></figure>
<p class="soft">{{ cloth.text }}</p>
</div>
{% endif %}
{% for card in cloth.cards %}
<article class="card">
<header><h3>{{ card.solver }}</h3><span class="kind">{{ card.kind }}</span><span class="soft">{{ card.seeds }}</span>
</header>
<dl class="numbers">{% for number in card.numbers %}
<div><dt>{{ number.name }}</dt><dd>{{ number.value }} <span class="of">{{ number.of }}</span></dd></div>
{% endfor %}</dl>
{% if card.problem %}<p class="empty">{{ card.problem }}</p>{% else %}
<div class="pictures">
{% for picture in card.pictures %}
<figure{% if picture.wide %} class="wide"{% endif %}><div class="frame{% if not picture.wide %} square{% endif %}">
<img src="{{ picture.source }}" alt="{{ picture.alt }}" loading="lazy"></div>
<figcaption>{{ picture.caption }}</figcaption></figure>
{% endfor %}
</div>
<div class="graphs">
<figure>{{ card.profile }}<figcaption><span class="key real"></span>real, training sample
 <span class="key simulated"></span>{{ card.fitted }}{% if card.band %}
 <span class="key band"></span>range of {{ card.band }} unseen samples{% endif %}</figcaption></figure>
{% if card.trace %}<figure>{{ card.trace }}<figcaption>Best training loss against cost</figcaption></figure>{% endif %}
{% if card.draws %}<figure class="draws"><div class="frame"><img src="{{ card.draws.source }}"
 alt="{{ card.draws.alt }}" loading="lazy"></div><figcaption>{{ card.draws.caption }}</figcaption></figure>{% endif %}
</div>
{% endif %}
</article>
{% endfor %}
</section>
{% endfor %}
</main>
</body>
</html>
"""
