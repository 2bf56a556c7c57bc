// Pointer, fingers, wheel and keys on the canvas.

/**
 * Hands what happens on a canvas to a viewer: `act(work)` runs `work(session)` if there is one, `command(name)` does what a key asks
 * for, `turnsLight()` says whether dragging turns the light.
 */
export function listen(canvas, host) {
  const at = (event) => {
    const box = canvas.getBoundingClientRect();
    return [(event.clientX - box.left) * canvas.width / box.width, (event.clientY - box.top) * canvas.height / box.height];
  };
  // With the light chosen one finger turns it, as the mouse does.
  const asTouch = (event) => event.pointerType === "touch" && !host.turnsLight();
  canvas.addEventListener("pointerdown", (event) => host.act((session) => {
    canvas.focus({ preventScroll: true });
    try { canvas.setPointerCapture(event.pointerId); } catch { /* it is gone already */ }
    const [x, y] = at(event);
    if (asTouch(event)) session.touch(event.pointerId, 0, x, y);
    else session.down(event.button, x, y, event.shiftKey, event.ctrlKey || event.metaKey || host.turnsLight());
  }));
  canvas.addEventListener("pointermove", (event) => host.act((session) => {
    const [x, y] = at(event);
    if (asTouch(event)) session.touch(event.pointerId, 1, x, y);
    else session.moved(x, y);
  }));
  for (const end of ["pointerup", "pointercancel"]) {
    canvas.addEventListener(end, (event) => host.act((session) => {
      if (asTouch(event)) session.touch(event.pointerId, 2, ...at(event));
      else if (event.buttons === 0) session.up();
    }));
  }
  canvas.addEventListener("contextmenu", (event) => event.preventDefault());
  canvas.addEventListener("wheel", (event) => {
    // A page with a picture in it still scrolls, until the picture is chosen.
    if (canvas.getRootNode().activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    const unit = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? 16 : 1;
    host.act((session) => session.wheel(-event.deltaY * unit));
  }, { passive: false });
  const key = (event, down) => {
    // Keys of the browser, and of screen readers.
    if (event.altKey || event.ctrlKey || event.metaKey || event.code === "Tab" || /^F\d/.test(event.code)) return;
    host.act((session) => {
      const command = session.key(event.code, down, event.repeat, event.shiftKey);
      if (command) host.command(command);
      event.preventDefault();
    });
  };
  canvas.addEventListener("keydown", (event) => key(event, true));
  canvas.addEventListener("keyup", (event) => key(event, false));
  canvas.addEventListener("blur", () => host.act((session) => session.blur()));
}
