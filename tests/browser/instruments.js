// Measurements of a page from outside of its modules, installed before its first script runs.
//
// instruments.frames: one entry for each picture of the server that the page drew, from the moment
// at which its decoded bitmap was given to a canvas. instruments.sockets: every WebSocket.
"use strict";
(() => {
  const instruments = {
    // {time_s, sequence, robot, camera, age_s, received_ms, drawn_ms, shown_ms}; milliseconds since
    // the start of the navigation. shown_ms: the next animation frame, an upper limit.
    frames: [],
    sockets: [],
    // {duration, startTime} of each task of the main thread above 50 ms.
    longTasks: [],
    timeOrigin: performance.timeOrigin,
  };
  const maxFrames = 5000;
  const headersBySize = new Map();
  const headersByBitmap = new WeakMap();

  function readFrame(buffer) {
    const received_ms = performance.now();
    const size = new DataView(buffer).getUint32(0, true);
    const header = JSON.parse(new TextDecoder().decode(new Uint8Array(buffer, 4, size)));
    // Decoded bitmaps are matched to headers by the size of the encoded image.
    headersBySize.set(buffer.byteLength - 4 - size, { header, received_ms });
    if (headersBySize.size > 64) headersBySize.delete(headersBySize.keys().next().value);
  }

  window.WebSocket = new Proxy(WebSocket, {
    construct(target, parameters) {
      const socket = new target(...parameters);
      instruments.sockets.push(socket);
      socket.addEventListener("message", (event) => {
        if (event.data instanceof ArrayBuffer) readFrame(event.data);
      });
      return socket;
    },
  });

  const decode = window.createImageBitmap;
  window.createImageBitmap = async function (source, ...rest) {
    const found = source instanceof Blob ? headersBySize.get(source.size) : undefined;
    const bitmap = await decode.call(window, source, ...rest);
    if (found) headersByBitmap.set(bitmap, found);
    return bitmap;
  };

  function record(bitmap) {
    const found = bitmap instanceof ImageBitmap ? headersByBitmap.get(bitmap) : undefined;
    if (!found || found.isDrawn) return;
    found.isDrawn = true;
    const { header, received_ms } = found;
    const { time_s, sequence, robot, camera, age_s, width_px } = header;
    const frame = { time_s, sequence, robot, camera, age_s, width_px, received_ms };
    frame.drawn_ms = performance.now();
    if (instruments.frames.length < maxFrames) instruments.frames.push(frame);
    requestAnimationFrame(() => (frame.shown_ms = performance.now()));
  }

  function wrap(prototype, name) {
    const original = prototype[name];
    prototype[name] = function (...parameters) {
      parameters.forEach(record);
      return original.apply(this, parameters);
    };
  }
  wrap(WebGL2RenderingContext.prototype, "texImage2D");
  wrap(WebGL2RenderingContext.prototype, "texSubImage2D");
  wrap(CanvasRenderingContext2D.prototype, "drawImage");
  wrap(ImageBitmapRenderingContext.prototype, "transferFromImageBitmap");

  new PerformanceObserver((list) => {
    for (const { duration, startTime } of list.getEntries()) {
      instruments.longTasks.push({ duration, startTime });
    }
  }).observe({ type: "longtask", buffered: true });

  // Centre [x, y] of an element in the viewport; null for an invisible one.
  instruments.scrollTo = (selector) => {
    const element = document.querySelector(selector);
    if (!element || !element.checkVisibility()) return null;
    element.scrollIntoView({ block: "center", behavior: "instant" });
    const { x, y, width, height } = element.getBoundingClientRect();
    return [x + width / 2, y + height / 2];
  };

  const controls =
    'a[href], button, input, select, textarea, summary, [tabindex]:not([tabindex="-1"]), ' +
    '[contenteditable="true"]';
  // Elements that a user can operate now; radio buttons of one group are one stop of the Tab key.
  instruments.listControls = () => {
    const groups = new Set();
    return [...document.querySelectorAll(controls)].filter((element) => {
      if (element.disabled || element.type === "hidden" || element.tabIndex < 0) return false;
      if (!element.checkVisibility({ visibilityProperty: true })) return false;
      if (element.type !== "radio" || !element.name) return true;
      const isFirst = !groups.has(element.name);
      groups.add(element.name);
      return isFirst;
    });
  };

  // A control for a report of a failed test.
  instruments.describe = (element) => {
    const panel = element.closest("section, header.bar")?.id ?? "";
    const name = element.ariaLabel || element.title || element.textContent.trim() || element.id;
    return `${panel} ${element.localName} ${name.slice(0, 40)}`;
  };

  window.instruments = instruments;
})();
