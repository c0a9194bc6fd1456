/** Gestures of mouse, pen and fingers on a view. */

const TAP_PX = 4;
const ZOOM_PER_WHEEL_PX = 0.0015;
const PX_PER_LINE = 33;

/**
 * Call handlers for gestures on an element: drag(dx, dy), zoom(factor, x, y), hover(x, y), leave(),
 * tap(x, y), and for a double click aim(x, y); each may be missing. Positions in its CSS pixels.
 */
export function watchGestures(node, handlers) {
  const gestures = new Gestures(handlers);
  node.addEventListener("pointerdown", (event) => gestures.down(node, event));
  for (const type of ["move", "up", "cancel"])
    node.addEventListener(`pointer${type}`, (event) => gestures[type](event));
  node.addEventListener("pointerleave", (event) => {
    if (event.pointerType === "mouse") handlers.leave?.();
  });
  if (handlers.aim) {
    node.addEventListener("dblclick", (event) => handlers.aim(event.offsetX, event.offsetY));
  }
  if (handlers.zoom) {
    const onWheel = (event) => {
      event.preventDefault();
      const px = event.deltaMode === WheelEvent.DOM_DELTA_LINE ? PX_PER_LINE : 1;
      const factor = Math.exp(-event.deltaY * px * ZOOM_PER_WHEEL_PX);
      handlers.zoom(factor, event.offsetX, event.offsetY);
    };
    node.addEventListener("wheel", onWheel, { passive: false });
  }
}

/** Steps right and down of the arrow keys. */
export const ARROWS = {
  ArrowLeft: [-1, 0],
  ArrowRight: [1, 0],
  ArrowUp: [0, -1],
  ArrowDown: [0, 1],
};

/** Gestures that move a cursor which is not held; `place(position, isHeld)`. */
export function cursorGestures(context, place) {
  const unlessHeld = (action) => (x, y) => {
    if (!context.cursor.isHeld) action([x, y]);
  };
  return {
    hover: unlessHeld((position) => place(position, false)),
    leave: unlessHeld(() => context.setCursor(null)),
    tap: (x, y) => place([x, y], true),
  };
}

class Gestures {
  #handlers;
  #pointers = new Map();
  #start = null;
  #isTap = false;

  constructor(handlers) {
    this.#handlers = handlers;
  }

  down(node, event) {
    if (event.button !== 0) return;
    node.setPointerCapture(event.pointerId);
    this.#pointers.set(event.pointerId, [event.offsetX, event.offsetY]);
    this.#start = [event.offsetX, event.offsetY];
    this.#isTap = this.#pointers.size === 1;
  }

  move(event) {
    const position = [event.offsetX, event.offsetY];
    const previous = this.#pointers.get(event.pointerId);
    if (previous === undefined) {
      if (event.pointerType === "mouse") this.#handlers.hover?.(...position);
      return;
    }
    if (distance(position, this.#start) > TAP_PX) this.#isTap = false;
    if (this.#isTap) return;
    if (this.#pointers.size === 1) {
      this.#handlers.drag?.(position[0] - previous[0], position[1] - previous[1]);
    } else {
      this.#pinch(event.pointerId, previous, position);
    }
    this.#pointers.set(event.pointerId, position);
  }

  up(event) {
    const isTap = this.#pointers.delete(event.pointerId) && this.#isTap;
    if (isTap && this.#pointers.size === 0) this.#handlers.tap?.(event.offsetX, event.offsetY);
  }

  cancel(event) {
    this.#pointers.delete(event.pointerId);
  }

  /** Zoom about the finger that rests, by the distance of the one that moves. */
  #pinch(pointerId, previous, position) {
    const [other] = [...this.#pointers].find(([id]) => id !== pointerId)?.slice(1) ?? [];
    if (!other) return;
    const factor = distance(position, other) / Math.max(distance(previous, other), 1);
    if (factor > 0) this.#handlers.zoom?.(factor, ...other);
  }
}

function distance([x1, y1], [x2, y2]) {
  return Math.hypot(x1 - x2, y1 - y2);
}
