// What is in the element: its shadow tree.

export const template = document.createElement("template");
template.innerHTML = `
  <img class="poster" part="poster" alt="" hidden>
  <canvas part="canvas" tabindex="0" role="application" aria-roledescription="3D view" aria-describedby="keys"></canvas>
  <p id="keys" class="unseen">Arrows turn, plus and minus go nearer and further, L with arrows turns the light, question mark lists
    all keys, Escape leaves.</p>
  <p class="unseen" role="status" aria-live="polite"></p>
  <div class="progress" part="progress" role="progressbar" aria-label="Quality" aria-valuemin="0" aria-valuemax="100"
    aria-valuenow="0"><i></i></div>
  <div class="toolbar" part="toolbar" role="toolbar" aria-label="View">
    <button type="button" data-do="reset" title="Camera and light as in the beginning (R)">Reset</button>
    <button type="button" data-do="light" aria-pressed="false" title="Dragging turns the light (hold L)">Light</button>
    <button type="button" data-do="next-shape" title="Next shape (M)" hidden>Shape</button>
    <button type="button" data-do="turntable" title="Once around (T)">Turn</button>
    <button type="button" data-do="fullscreen" title="Full screen">Full</button>
    <button type="button" data-do="help" title="Keys (?)" aria-haspopup="dialog">Keys</button>
  </div>
  <div class="notice" part="notice" role="alert" hidden><p></p><button type="button">Try again</button></div>
  <dialog aria-label="Keys and gestures"><form method="dialog"><table><tbody></tbody></table><button>Close</button></form></dialog>`;
