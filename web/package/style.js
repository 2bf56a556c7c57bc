// The viewer's style: a sheet of its own, which pages with a strict Content-Security-Policy allow. Pages change it by ::part().

export const style = new CSSStyleSheet();

style.replaceSync(`
:host { display: block; container-type: inline-size; position: relative; overflow: hidden; min-height: 12rem; background: #111; color: #eee;
  font: 0.875rem/1.4 system-ui, sans-serif; }
:host([hidden]) { display: none; }
canvas, .poster { position: absolute; inset: 0; width: 100%; height: 100%; }
canvas { touch-action: none; outline-offset: -3px; cursor: grab; opacity: 0; }
canvas:active { cursor: grabbing; }
:host([shown]) canvas { opacity: 1; transition: opacity 0.15s; }
canvas:focus-visible { outline: 3px solid #6cf; }
.poster { object-fit: cover; }
.poster[hidden] { display: none; }
:host([unsupported]) canvas, :host([unsupported]) .toolbar, :host([unsupported]) .progress { display: none; }
.unseen { position: absolute; width: 1px; height: 1px; margin: 0; overflow: hidden; clip-path: inset(50%); white-space: nowrap; }
.progress { position: absolute; inset: auto 0 0 0; height: 3px; background: #0006; }
.progress i { display: block; height: 100%; width: 0; background: #6cf; transition: width 0.2s; }
.progress.done { opacity: 0; transition: opacity 0.6s 0.4s; }
.toolbar { position: absolute; inset: auto 0.5rem 0.75rem auto; display: flex; flex-wrap: wrap; gap: 0.25rem; justify-content: end; }
button { font: inherit; color: #eee; background: #222c; border: 1px solid #888; border-radius: 0.4rem; padding: 0.35rem 0.7rem;
  min-height: 2.25rem; cursor: pointer; }
button[hidden] { display: none; }
button:hover { background: #444c; }
button:focus-visible { outline: 3px solid #6cf; outline-offset: 1px; }
button[aria-pressed=true] { background: #ffe08a; color: #111; }
.notice { position: absolute; inset: 0.75rem 0.75rem auto 0.75rem; display: flex; gap: 0.75rem; align-items: center;
  justify-content: space-between; background: #311d; border: 1px solid #e88; border-radius: 0.5rem; padding: 0.6rem 0.8rem; }
.notice[hidden] { display: none; }
.notice p { margin: 0; overflow-wrap: anywhere; max-height: 10em; overflow: auto; }
dialog { color: #eee; background: #222; border: 1px solid #888; border-radius: 0.5rem; max-height: 80%; }
dialog::backdrop { background: #0008; }
th { text-align: start; font-weight: 600; padding: 0.15rem 1rem 0.15rem 0; vertical-align: top; }
@container (max-width: 28rem) { .toolbar button { padding: 0.3rem 0.45rem; } }
@container (max-width: 15rem) { .toolbar { display: none; } }
@media (prefers-reduced-motion: reduce) { :host * { transition: none !important; } }
`);
