// Style sheet and script of the report. The script only adds: the page is complete without it.
#include "report_internal.hpp"

namespace servosense::report::detail {

// Colours of the curves keep apart for the common kinds of colour blindness (after Okabe and Ito
// 2008, darkened on white) and from the red and amber of alarms, which also differ in dash and
// flag.
const std::string_view kStyle = R"css(
:root{--paper:#fff;--raised:#f5f7f9;--ink:#1b2229;--soft:#55606b;--rule:#d5dbe1;--grid:#e4e8ec;
--alarm:#b3261e;--warning:#8a5300;--info:#4a5a6a;--on-flag:#fff;--focus:#0b63c4;--bar:#4f7fae;
--s0:#0060a8;--s1:#c24f00;--s2:#007a5a;--s3:#a0448a;--s4:#7d6608;--s5:#1d8fc1;--s6:#5b4bb5;--s7:#505860}
@media screen and (prefers-color-scheme:dark){:root{--paper:#14191e;--raised:#1d242b;--ink:#e8ecf0;
--soft:#a9b4bf;--rule:#3a444e;--grid:#29323a;--alarm:#ff8a80;--warning:#ffc04d;--info:#a9bccd;
--on-flag:#14191e;--focus:#7ab8ff;--bar:#6f9fcd;--s0:#5cb3f0;--s1:#ff9a5a;--s2:#38c79d;--s3:#e596cc;
--s4:#e6cf55;--s5:#9bd8f5;--s6:#b3a6ff;--s7:#c3cbd3}}
*{box-sizing:border-box}
html{background:var(--paper);color:var(--ink);color-scheme:light dark;-webkit-text-size-adjust:100%;text-size-adjust:100%}
body{font:15px/1.5 system-ui,-apple-system,"Segoe UI",Roboto,"Noto Sans","Liberation Sans",Arial,sans-serif;
max-width:1060px;margin:0 auto;padding:28px 28px 48px;overflow-wrap:break-word}
h1{font-size:27px;line-height:1.2;margin:0 0 4px;letter-spacing:-.01em}
h2{font-size:20px;line-height:1.3;margin:40px 0 10px;padding-top:14px;border-top:1px solid var(--rule)}
h3{font-size:16px;line-height:1.35;margin:0}
header p{margin:0;color:var(--soft)}
header{margin-bottom:20px}
p{max-width:46em;margin:10px 0}
a{color:var(--focus)}
nav ul{list-style:none;display:flex;flex-wrap:wrap;gap:2px 18px;padding:0;margin:0 0 20px}
footer{display:none;margin-top:40px;color:var(--soft);font-size:13px}
.live footer{display:block}
.key{display:grid;grid-template-columns:repeat(auto-fit,minmax(150px,1fr));gap:12px;margin:20px 0}
.key div{background:var(--raised);border-radius:8px;padding:12px 14px;border-left:4px solid var(--rule)}
.key dt{color:var(--soft);font-size:13px;line-height:1.35}
.key dd{margin:2px 0 0}
.key b{font-size:25px;line-height:1.25;font-weight:650;font-variant-numeric:tabular-nums}
.key em{font-style:normal;font-weight:650;font-size:13px;margin-left:10px}
.key .alarm{border-color:var(--alarm)}.key .warning{border-color:var(--warning)}.key .info{border-color:var(--info)}
.key .alarm em{color:var(--alarm)}.key .warning em{color:var(--warning)}
.note{max-width:none;border-left:4px solid var(--info);background:var(--raised);padding:10px 14px;border-radius:0 6px 6px 0}
.note.alarm{border-color:var(--alarm)}.note.warning{border-color:var(--warning)}
.note.alarm b{color:var(--alarm)}.note.warning b{color:var(--warning)}
figure{margin:26px 0;position:relative}
figcaption p{margin:2px 0 0;color:var(--soft);font-size:14px;max-width:54em}
.group figure{margin:12px 0 0}
.group-title{margin-top:26px}
.group h3:not(.group-title){font-size:14px}
.legend{list-style:none;display:flex;flex-wrap:wrap;gap:2px 20px;padding:0;margin:8px 0 0;font-size:13px}
.legend li{display:flex;align-items:center;gap:7px;min-width:0}
.legend svg{flex:none}
.frame{padding:0 18px 44px 56px;position:relative}
.frame.bare{padding-bottom:8px}
svg.area{display:block;overflow:visible;touch-action:pan-y}
svg.area:focus-visible{outline:2px solid var(--focus);outline-offset:3px}
svg text{font-size:12px;fill:var(--soft);font-variant-numeric:tabular-nums}
.paper{fill:var(--paper)}
.border{fill:none;stroke:var(--rule);pointer-events:none}
.grid{stroke:var(--grid);shape-rendering:crispEdges}
.minor{opacity:.55}
.narrow{display:none}
.tick.x,.empty,.flag text{text-anchor:middle}
.tick.y{text-anchor:end}
svg text.axis{fill:var(--ink)}
.axis.x{text-anchor:end}
svg text.empty{font-size:15px}
.data path,.swatch path,.lens path{vector-effect:non-scaling-stroke;stroke-linejoin:round;stroke-linecap:round}
.curve,.contour{fill:none}
.curve{stroke-width:1.5}
.again{stroke-dasharray:7 4}
.points{stroke-width:4.5}
.faint{opacity:.32}
.broad{stroke-width:6;opacity:.35}
.vertical{fill:none;stroke-width:1.5;stroke-dasharray:9 4 2 4;stroke:var(--ink)}
.s0{stroke:var(--s0)}.s1{stroke:var(--s1)}.s2{stroke:var(--s2)}.s3{stroke:var(--s3)}
.s4{stroke:var(--s4)}.s5{stroke:var(--s5)}.s6{stroke:var(--s6)}.s7{stroke:var(--s7)}
.data path.bars{fill:var(--bar);stroke:var(--paper);stroke-width:.4}
.data .cells path{stroke:none;shape-rendering:crispEdges}
.data .cells path,.colour-bar rect{print-color-adjust:exact;-webkit-print-color-adjust:exact}
.contour{stroke:#fff;stroke-width:1.8}
.contour.halo{stroke:#000;stroke-width:4;opacity:.75}
.contour.c1{stroke-dasharray:8 5}.contour.c2{stroke-dasharray:2 5}
.swatch .contour{stroke:var(--ink)}
.span{fill:var(--info);stroke:var(--info);fill-opacity:.13;stroke-opacity:.3;print-color-adjust:exact;-webkit-print-color-adjust:exact}
.span.alarm{fill:var(--alarm);stroke:var(--alarm)}.span.warning{fill:var(--warning);stroke:var(--warning)}
.mark{stroke:var(--info);stroke-width:1.25;stroke-dasharray:2 3}
.mark.warning{stroke:var(--warning);stroke-dasharray:6 3}.mark.alarm{stroke:var(--alarm);stroke-dasharray:none}
line.limit{stroke:var(--info);stroke-width:1.25;stroke-dasharray:9 4 2 4}
line.limit.warning{stroke:var(--warning)}line.limit.alarm{stroke:var(--alarm)}
text.limit{text-anchor:end;fill:var(--info);paint-order:stroke;stroke:var(--paper);stroke-width:4px;stroke-linejoin:round}
text.limit.left{text-anchor:start}text.limit.warning{fill:var(--warning)}text.limit.alarm{fill:var(--alarm)}
svg.flag{overflow:visible}
.flag rect{fill:var(--paper);stroke:var(--info)}
.flag text{fill:var(--info);font-weight:650}
.flag.warning rect{stroke:var(--warning)}.flag.warning text{fill:var(--warning)}
.flag.alarm rect{fill:var(--alarm);stroke:var(--alarm);print-color-adjust:exact;-webkit-print-color-adjust:exact}
.flag.alarm text{fill:var(--on-flag)}
.marks{list-style:none;padding:0;margin:4px 0 0;font-size:14px}
.marks.many{columns:2 320px;column-gap:28px}
.marks li{display:flex;gap:9px;padding:2px 0;break-inside:avoid;align-items:baseline}
.marks li>span:last-child{min-width:0}
.marks .number{flex:none;min-width:24px;text-align:center;font-size:12px;line-height:17px;font-weight:650;
border:1px solid var(--info);border-radius:3px;color:var(--info)}
.marks .warning .number{border-color:var(--warning);color:var(--warning)}
.marks .alarm .number{border-color:var(--alarm);background:var(--alarm);color:var(--on-flag);print-color-adjust:exact;-webkit-print-color-adjust:exact}
.marks b{font-weight:600;font-variant-numeric:tabular-nums;white-space:nowrap}
.remark{font-size:13px;color:var(--soft);margin:4px 0 0}
.colour-bar{display:flex;align-items:flex-start;gap:16px;margin:0 18px 0 56px;font-size:12px;line-height:15px}
.colour-bar span{flex:none;max-width:45%}
.colour-bar svg{overflow:visible;max-width:420px;margin-right:14px;shape-rendering:crispEdges}
.colour-bar line{stroke:var(--soft)}
.scroll{overflow-x:auto;margin-top:8px}
.scroll:focus-visible{outline:2px solid var(--focus)}
table{border-collapse:collapse;font-size:14px;font-variant-numeric:tabular-nums}
th,td{padding:6px 14px 6px 10px;text-align:left;vertical-align:top;border-bottom:1px solid var(--rule)}
thead th{font-weight:600;color:var(--soft);border-bottom:2px solid var(--rule);vertical-align:bottom}
td.number,th.number{text-align:right}
td.number{white-space:nowrap}
.table td,.table th{max-width:34em}
tr.alarm>:first-child{box-shadow:inset 4px 0 var(--alarm)}
tr.warning>:first-child{box-shadow:inset 4px 0 var(--warning)}
tr.info>:first-child{box-shadow:inset 4px 0 var(--info)}
tr.alarm td,tr.alarm th,tr.warning td,tr.warning th{font-weight:600}
tr.alarm>:first-child{color:var(--alarm)}tr.warning>:first-child{color:var(--warning)}
table.bars{width:100%;margin-top:8px}
.bars th[scope=row]{font-weight:400;width:28%;border:0;overflow-wrap:anywhere}
.bars td{border:0}.bars td:nth-child(2){padding-right:10px;width:60%}
.bars td svg{display:block;margin-top:3px}
.bar{fill:var(--bar);print-color-adjust:exact;-webkit-print-color-adjust:exact}
.alarm .bar{fill:var(--alarm)}.warning .bar{fill:var(--warning)}
.zero{stroke:var(--soft)}
.timeline rect{fill:none;print-color-adjust:exact;-webkit-print-color-adjust:exact}
.timeline .idle{fill:var(--grid)}.timeline .learning{fill:var(--rule)}.timeline .armed{fill:var(--bar)}
.timeline .warning rect,.timeline rect.warning{fill:var(--warning)}.timeline rect.alarm{fill:var(--alarm)}
.timeline rect.signal-fault{fill:var(--s4)}
.cursor{stroke:var(--ink);stroke-width:1;pointer-events:none}
text.read{fill:var(--ink);paint-order:stroke;stroke:var(--paper);stroke-width:5px;stroke-linejoin:round;pointer-events:none}
.window{fill:var(--ink);fill-opacity:.07;pointer-events:none}
.lens{position:absolute;z-index:2;width:min(340px,44%);background:var(--paper);border:1px solid var(--soft);border-radius:8px;
box-shadow:0 6px 24px #0005;padding:8px 10px;font-size:13px;line-height:1.4;pointer-events:none;font-variant-numeric:tabular-nums}
.lens[hidden]{display:none}
.lens p{margin:0;display:flex;gap:8px;justify-content:space-between}
.lens p.where{font-weight:650}
.lens .name{display:flex;gap:6px;align-items:center;min-width:0;overflow:hidden;text-overflow:ellipsis;white-space:nowrap}
.lens .value{white-space:nowrap}
.lens svg.zoom{display:block;width:100%;height:120px;margin:5px 0 2px;background:var(--raised);border-radius:4px}
.lens small{display:flex;justify-content:space-between;color:var(--soft);font-size:11px}
@media (max-width:640px){
body{padding:18px 14px 40px}
h1{font-size:23px}
.wide{display:none}.narrow{display:inline}
.frame{padding-left:54px;padding-right:16px}
.key{grid-template-columns:1fr 1fr}
.key b{font-size:21px}
.colour-bar{display:block;margin:0 16px 0 54px}
.colour-bar span{display:block;max-width:none;margin-bottom:3px}
.lens{position:fixed;left:8px;right:8px;bottom:8px;width:auto}
.bars th[scope=row]{width:34%}.bars td:nth-child(2){width:45%}
th,td{padding-left:6px;padding-right:8px}
.scroll td:last-child:not(.number){min-width:14em}
}
@media print{
@page{margin:14mm}
body{max-width:none;padding:0;font-size:10.5pt}
figure,.key,.note,tr{break-inside:avoid}
figure.table{break-inside:auto}
h2,h3,figcaption{break-after:avoid}
.wide{display:inline}.narrow{display:none}
.lens,.cursor,.read,.window,.live footer,nav{display:none}
.scroll{overflow:visible}
.key div,.note{border:1px solid var(--rule);border-left-width:4px}
}
)css";

const std::string_view kScript = R"js(
'use strict';
(() => {
const half = 0.02;  // of the axis, either side of the cursor
const minus = s => s.replace(/-/g, '\u2212');
const onAxis = (a, v) => a.log ? Math.log(v / a.from) / Math.log(a.to / a.from) : (v - a.from) / (a.to - a.from);
const fromAxis = (a, u) => a.log ? a.from * Math.pow(a.to / a.from, u) : a.from + u * (a.to - a.from);
const text = (a, v, finer) => {
  if (!Number.isFinite(v)) return '\u2013';
  if (a.log) return minus(String(Number(v.toPrecision(4))));
  const digits = Math.ceil(finer - Math.log10((a.to - a.from) * a.scale));
  return minus((v * a.scale).toFixed(Math.min(Math.max(digits, 0), 15)));
};
const withUnit = (s, unit) => unit ? s + '\u00a0' + unit : s;
const decode = s => {
  const raw = atob(s), bytes = new Uint8Array(raw.length);
  for (let i = 0; i !== raw.length; ++i) bytes[i] = raw.charCodeAt(i);
  return new Float32Array(bytes.buffer);
};
const html = (name, cls, parent) => {
  const e = document.createElement(name);
  if (cls) e.className = cls;
  if (parent) parent.append(e);
  return e;
};

class Picture {
  constructor(area) {
    this.area = area;
    this.frame = area.parentNode;
    this.figure = area.closest('figure');
    this.json = this.frame.querySelector('script');
    this.u = 0.5;
    // A native tooltip would cover the lens: the title moves to the label.
    const title = area.querySelector('title');
    area.setAttribute('aria-label', title.textContent);
    area.setAttribute('aria-describedby', area.querySelector('desc').id);
    area.removeAttribute('aria-labelledby');
    title.remove();
    const legend = [...this.figure.querySelectorAll('.legend li span')];
    this.names = legend.map(e => e.textContent);
  }
  svg(name, cls, parent, attributes) {
    const e = document.createElementNS(this.area.namespaceURI, name);
    if (cls) e.setAttribute('class', cls);
    for (const k in attributes) e.setAttribute(k, attributes[k]);
    (parent || this.area).append(e);
    return e;
  }
  load() {
    if (this.data) return;
    this.data = JSON.parse(this.json.textContent);
    for (const s of this.data.series || []) if (s) s.values = decode(s.data);
    if (this.data.cells) this.data.cells.values = decode(this.data.cells.data);
  }
  // Nearest sample, or the envelope of the column, under the cursor.
  value(s, u) {
    const v = s.values;
    if (s.kind === 'envelope') {
      const n = v.length / 2, i = Math.min(Math.floor(u * n), n - 1);
      return [v[2 * i] + s.offset, v[2 * i + 1] + s.offset];
    }
    if (s.kind !== 'points') return null;
    let best = -1;
    for (let i = 0; i !== v.length; i += 2) {
      const d = Math.abs(v[i] - u);
      if (s.style === 'step' ? u >= v[i] : (best === -1 || !(d >= Math.abs(v[best] - u)))) if (d === d) best = i;
    }
    if (best === -1 || (s.style !== 'step' && Math.abs(v[best] - u) > 0.05)) return [NaN, NaN];
    return [v[best + 1] + s.offset, v[best + 1] + s.offset];
  }
  reading(s, u) {
    const y = this.data.y, r = this.value(s, u);
    if (!r) return '';
    const low = text(y, r[0], 4), high = text(y, r[1], 4);
    return withUnit(low === high ? low : low + ' \u2026 ' + high, this.area.dataset.yUnit);
  }
  readings(u) {
    const d = this.data, x = d.x, unit = this.area.dataset;
    const bin = (edges, v) => edges.findIndex((e, i) => i + 1 !== edges.length && v >= e && edges[i + 1] > v);
    if (d.bars) {
      const i = bin(d.bars.edges, fromAxis(x, u));
      return i === -1 ? [] : [['', withUnit(text(x, d.bars.edges[i], 3) + ' to ' + text(x, d.bars.edges[i + 1], 3), unit.xUnit)],
        ['Count', String(d.bars.counts[i])]];
    }
    return (d.series || []).map((s, i) => [this.names[i] || unit.yLabel, s ? this.reading(s, u) : '', i]).filter(r => r[1]);
  }
  cell(u, w) {
    const d = this.data, c = d.cells, bin = (edges, v) => edges.findIndex((e, i) => i + 1 !== edges.length && v >= e && edges[i + 1] >= v);
    const column = bin(c.x, fromAxis(d.x, u)), row = bin(c.y, fromAxis(d.y, w));
    const z = c.values[row * (c.x.length - 1) + column];
    return Number.isFinite(z) ? withUnit(minus(String(Number((z * c.scale).toPrecision(4)))), this.area.dataset.zUnit) : 'no value';
  }
  showCursor(u, alone) {
    this.load();
    this.hideCursor();
    const at = 100 * u + '%', height = this.data.height;
    this.marks = [this.svg('line', 'cursor', null, {x1: at, x2: at, y2: height})];
    if (alone || !this.data.series) return;
    this.readings(u).forEach((r, i) => {
      const t = this.svg('text', 'read', null, {x: at, dx: u > 0.5 ? -7 : 7, y: 16 + 16 * i,
        'text-anchor': u > 0.5 ? 'end' : 'start'});
      t.textContent = (this.names.length > 1 ? r[0] + ': ' : '') + r[1];
      this.marks.push(t);
    });
  }
  hideCursor() { for (const e of this.marks || []) e.remove(); this.marks = []; }
  hideLens() { if (this.lens) this.lens.hidden = true; }
  showLens(u, w) {
    const d = this.data, unit = this.area.dataset;
    if (!this.lens) {
      this.lens = html('div', 'lens', this.frame);
      this.lens.setAttribute('aria-live', 'polite');
    }
    const lens = this.lens;
    lens.textContent = '';
    lens.hidden = false;
    const line = (cls, name, value, i) => {
      const p = html('p', cls, lens), n = html('span', 'name', p);
      if (i !== undefined && this.names.length > 1) {
        const swatch = this.figure.querySelectorAll('.legend .swatch')[i];
        if (swatch) n.append(swatch.cloneNode(true));
      }
      n.append(name);
      html('span', 'value', p).textContent = value;
    };
    line('where', unit.xLabel || 'x', withUnit(text(d.x, fromAxis(d.x, u), 4), unit.xUnit));
    if (d.cells) {
      line('', 'y', withUnit(text(d.y, fromAxis(d.y, w), 3), unit.yUnit));
      line('', 'value', this.cell(u, w));
    } else {
      for (const r of this.readings(u)) line('', r[0], r[1], r[2]);
    }
    if (d.series && d.series.some(s => s)) this.zoom(lens, u);
    const left = u > 0.5;
    lens.style.left = left ? '62px' : '';
    lens.style.right = left ? '' : '24px';
    lens.style.top = this.frame.style.paddingTop;
    lens.style.marginTop = '6px';
    if (matchMedia('(max-width:640px)').matches) lens.style.cssText = '';
  }
  // The stretch of the curves around the cursor, with a y axis of its own.
  zoom(lens, u) {
    const d = this.data, from = u - half, to = u + half, W = 1000, H = 300;
    const y = v => onAxis(d.y, v);
    let low = Infinity, high = -Infinity;
    const seen = v => { if (Number.isFinite(v)) { low = Math.min(low, v); high = Math.max(high, v); } };
    const curves = d.series.map((s, index) => {
      const points = [];
      if (!s) return points;
      const v = s.values, n = v.length / 2;
      if (s.kind === 'envelope') {
        const last = Math.min(n - 1, Math.ceil(to * n));
        for (let i = Math.max(0, Math.floor(from * n) - 1); last >= i; ++i) {
          const at = (i + 0.5) / n;
          for (const k of [0, 1]) points.push([at, y(v[2 * i + k] + s.offset)]);
        }
      } else {
        let before = NaN;
        for (let i = 0; i !== n; ++i) {
          const at = v[2 * i], value = y(v[2 * i + 1] + s.offset);
          if (s.style === 'step') points.push([at, before]);
          points.push([at, value]);
          before = value;
        }
      }
      points.forEach((p, i) => {
        const next = points[i + 1] || p, prior = points[i - 1] || p;
        if (Math.max(p[0], next[0]) >= from && to >= Math.min(p[0], prior[0])) seen(p[1]);
      });
      return points;
    });
    if (!(high >= low)) return;
    const rise = Math.max(high - low, 1e-6), bottom = low - 0.08 * rise, top = high + 0.08 * rise;
    const px = at => (at - from) / (to - from) * W, py = v => (top - v) / (top - bottom) * H;
    const caption = html('small', '', lens);
    const picture = this.svg('svg', 'zoom', lens, {viewBox: '0 0 ' + W + ' ' + H, preserveAspectRatio: 'none'});
    const path = (cls, dd) => this.svg('path', cls, picture, {d: dd});
    for (const [value, level] of d.limits) {
      const v = onAxis(d.y, value);
      if (v >= bottom && top >= v) this.svg('line', 'limit ' + level, picture, {x2: W, y1: py(v), y2: py(v), 'vector-effect': 'non-scaling-stroke'});
    }
    for (const [at, level] of d.marks)
      if (at >= from && to >= at) this.svg('line', 'mark ' + level, picture, {x1: px(at), x2: px(at), y2: H, 'vector-effect': 'non-scaling-stroke'});
    curves.forEach((points, i) => {
      let dd = '', pen = false;
      const dots = d.series[i] && d.series[i].style === 'points';
      for (const [at, v] of points) {
        if (!Number.isFinite(v)) { pen = false; continue; }
        const X = Math.min(Math.max(px(at), -9 * W), 10 * W).toFixed(1), Y = py(v).toFixed(1);
        dd += pen && !dots ? 'L' + X + ' ' + Y : 'M' + X + ' ' + Y + 'h0';
        pen = true;
      }
      path('curve s' + i % 8 + (dots ? ' points' : ''), dd);
    });
    this.svg('line', 'cursor', picture, {x1: W / 2, x2: W / 2, y2: H, 'vector-effect': 'non-scaling-stroke', 'stroke-dasharray': '2 3'});
    const end = v => text(d.y, fromAxis(d.y, v), 4);
    html('span', '', caption).textContent = withUnit(end(bottom) + ' to ' + end(top), this.area.dataset.yUnit);
    const scale = html('small', '', lens);
    html('span', '', scale).textContent = text(d.x, fromAxis(d.x, from), 4);
    html('span', '', scale).textContent = withUnit(text(d.x, fromAxis(d.x, to), 4), this.area.dataset.xUnit);
    const a = 100 * Math.max(0, from), b = 100 * Math.min(1, to);
    this.marks.push(this.svg('rect', 'window', null, {x: a + '%', width: b - a + '%', height: d.height}));
  }
}

const all = [...document.querySelectorAll('svg.area')].map(a => new Picture(a));
const kin = p => { const g = p.area.closest('.group'); return all.filter(q => q === p || (g && q.area.closest('.group') === g)); };
const hide = () => { for (const p of all) { p.hideCursor(); p.hideLens(); } };
const show = (p, u, w) => {
  for (const q of all) if (q !== p) q.hideLens();
  p.u = u = Math.min(Math.max(u, 0), 1);
  for (const q of kin(p)) { q.u = u; q.showCursor(u, q === p); }
  p.showLens(u, w);
};
for (const p of all) {
  const point = e => {
    const box = p.area.getBoundingClientRect();
    show(p, (e.clientX - box.left) / box.width, 1 - (e.clientY - box.top) / box.height);
  };
  p.area.addEventListener('pointermove', point);
  p.area.addEventListener('pointerdown', point);
  p.area.addEventListener('pointerleave', e => { if (e.pointerType === 'mouse') hide(); });
  p.area.addEventListener('blur', hide);
  p.area.addEventListener('keydown', e => {
    const step = e.shiftKey ? 0.02 : 0.002;
    const to = {ArrowLeft: p.u - step, ArrowRight: p.u + step, Home: 0, End: 1}[e.key];
    if (e.key === 'Escape') hide();
    if (to === undefined) return;
    e.preventDefault();
    show(p, to, 0.5);
  });
}
document.documentElement.classList.add('live');
})();
)js";

}  // namespace servosense::report::detail
