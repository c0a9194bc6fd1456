/** Inputs that drive a robot: keys, a gamepad and a stick on the screen. */

export const NEUTRAL = { forward: 0, turn: 0 };
const DEAD_ZONE = 0.1;
const GAMEPAD_INTERVAL_MS = 50;
/** Contribution of each key: forward, turn to the right. By position, on any keyboard layout. */
const KEYS = {
  KeyW: [1, 0],
  ArrowUp: [1, 0],
  KeyS: [-1, 0],
  ArrowDown: [-1, 0],
  KeyA: [0, -1],
  ArrowLeft: [0, -1],
  KeyD: [0, 1],
  ArrowRight: [0, 1],
};
const FIELDS = "input:not([type=checkbox], [type=range]), select, textarea, [contenteditable]";

/** Whether a key belongs to the element that has the focus; views prevent the default action. */
function isTaken({ target, code, defaultPrevented }) {
  if (defaultPrevented) return true;
  if (!(target instanceof Element)) return false;
  return target.matches(FIELDS) || (code.startsWith("Arrow") && target.matches("[type=range]"));
}

/**
 * Drive by W A S D and the arrow keys while `isReady()`. While the robot moves the space bar stops
 * it, whatever has the focus except a field; otherwise it presses the focused button as usual.
 *
 * @returns {() => void} forget all pressed keys
 */
export function listenToKeys({ isReady, onDemand, isMoving, onStop }) {
  const pressed = new Set();
  const update = () => {
    const demand = { ...NEUTRAL };
    for (const code of pressed) {
      demand.forward += KEYS[code][0];
      demand.turn += KEYS[code][1];
    }
    onDemand(demand);
  };
  addEventListener("keydown", (event) => {
    if (event.ctrlKey || event.altKey || event.metaKey || isTaken(event)) return;
    if (event.code === "Space" && isMoving()) {
      event.preventDefault();
      onStop();
    } else if (event.code in KEYS && isReady()) {
      event.preventDefault();
      if (event.repeat || pressed.has(event.code)) return;
      pressed.add(event.code);
      update();
    }
  });
  // A released key counts wherever the focus is: a press must never stay.
  addEventListener("keyup", (event) => {
    if (pressed.delete(event.code)) update();
  });
  return () => {
    pressed.clear();
    update();
  };
}

/** Axis value without the dead zone, growing from 0 at its edge. */
export function withoutDeadZone(value) {
  const size = Math.abs(value);
  if (!(size > DEAD_ZONE)) return 0;
  return Math.sign(value) * Math.min(1, (size - DEAD_ZONE) / (1 - DEAD_ZONE));
}

/** Drive by axes 0 (turn) and 1 (forward) of the first gamepad; `onName("")` without one. */
export function listenToGamepad(onDemand, onName) {
  let timer = null;
  const read = () => {
    const gamepad = [...(navigator.getGamepads?.() ?? [])].find((pad) => pad?.connected);
    if (!gamepad) return end();
    onDemand({
      forward: -withoutDeadZone(gamepad.axes[1] ?? 0),
      turn: withoutDeadZone(gamepad.axes[0] ?? 0),
    });
  };
  const end = () => {
    clearInterval(timer);
    timer = null;
    onDemand(NEUTRAL);
    onName("");
  };
  addEventListener("gamepadconnected", ({ gamepad }) => {
    onName(gamepad?.id ?? "gamepad");
    timer ??= setInterval(read, GAMEPAD_INTERVAL_MS);
  });
  addEventListener("gamepaddisconnected", () => timer !== null && read());
}

/** Drive by a stick: the knob follows pointer or finger within its circle, and springs back. */
export function listenToStick(stick, knob, onDemand) {
  let pointer = null;
  const move = (event) => {
    const box = stick.getBoundingClientRect();
    const radius = box.width / 2;
    const right = (event.clientX - box.left - radius) / radius;
    const down = (event.clientY - box.top - radius) / radius;
    const length = Math.max(1, Math.hypot(right, down));
    set(right / length, down / length);
  };
  const set = (right, down) => {
    knob.style.transform = `translate(${right * 100}%, ${down * 100}%)`;
    onDemand({ forward: -withoutDeadZone(down), turn: withoutDeadZone(right) });
  };
  const release = () => {
    pointer = null;
    set(0, 0);
  };
  stick.addEventListener("pointerdown", (event) => {
    if (pointer !== null || event.button !== 0) return;
    pointer = event.pointerId;
    stick.setPointerCapture(pointer);
    move(event);
  });
  stick.addEventListener("pointermove", (event) => event.pointerId === pointer && move(event));
  for (const type of ["pointerup", "pointercancel", "lostpointercapture"])
    stick.addEventListener(type, (event) => event.pointerId === pointer && release());
  return release;
}
