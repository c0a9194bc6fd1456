/** Start of the page: the server's description, two connections, the context of all panels. */

import { fetchCameraTable } from "./camera_table.js";
import { Connection, fetchJson } from "./connection.js";
import { startFeed, FeedStatistics } from "./feed.js";
import { createPanels, preparePanels } from "./panels.js";
import { setText } from "./panel.js";
import { robotFromMirror } from "./transforms.js";
import { Unwarper } from "./unwarper.js";

const FAULT_SHOWN_MS = 5000;
const WINDOW = { yaw_rad: 0, pitch_rad: -0.2, fov_rad: 1.3, aspect: 4 / 3 };

/** URL of the server's socket. */
function socketUrl() {
  const url = new URL("/socket", location.href);
  url.protocol = location.protocol === "https:" ? "wss:" : "ws:";
  return url.href;
}

const fetchServer = () => fetchJson("/api/server.json");

/** What all panels share. */
class Context {
  /** Robot and camera that all panels show; empty while there is none. */
  selected = { robot: "", camera: "" };
  /** Name of the robot that this page has spawned; empty for none. */
  own = "";
  /** Settings of the pictures that differ from the camera's, by the names of a FrameVariant. */
  variant = {};
  /** Whether this page drives a robot at present. */
  isDriving = false;
  /** Newest frame, {header, file, bitmap, received_ms}; its bitmap lives until the next one. */
  frame = null;
  /** Newest state, {reply, readings, notes}. */
  state = null;
  landmarks = [];
  /** CameraTable of the selected camera; null while loading and for other kinds of cameras. */
  table = null;
  /** Pictures of views, by WebGL2. */
  unwarper = new Unwarper(() => this.emit("unwarper"));
  /** Perspective view: yaw, pitch, horizontal field of view, width over height. */
  window = { ...WINDOW };
  /** Pixel [u, v] under the cursor, or null; held: placed by a click or by a key. */
  cursor = { pixel: null, isHeld: false };
  statistics = new FeedStatistics();
  #handlers = new Map();
  #tableOf = "";

  constructor(server) {
    this.server = server;
    this.pictures = new Connection(socketUrl());
    this.commands = new Connection(socketUrl());
  }

  /** Call a function on each event of a name from now on. */
  on(event, handler) {
    this.#handlers.set(event, [...(this.#handlers.get(event) ?? []), handler]);
  }

  /** Call the handlers of an event; the fault of one does not keep it from the others. */
  emit(event, data) {
    for (const handler of this.#handlers.get(event) ?? []) {
      try {
        handler(data);
      } catch (error) {
        console.error(`${event}:`, error);
      }
    }
  }

  /** Show a robot and one of its cameras; an empty camera is the first omnidirectional one. */
  select(robot, camera = "") {
    const chosen = camera || defaultCamera(this.camerasOf(robot));
    if (robot === this.selected.robot && chosen === this.selected.camera) return;
    this.selected = { robot, camera: chosen };
    this.variant = {};
    this.#forgetFrame();
    this.landmarks = [];
    this.loadTable();
    this.emit("selection", this.selected);
  }

  /** Cameras of a robot of the state, as server.json lists them. */
  camerasOf(robot) {
    return this.classOf(robot)?.cameras ?? [];
  }

  /** Class of a robot of the state; undefined for an unknown robot. */
  classOf(robot) {
    const name = this.state?.reply.robots.find((one) => one.name === robot)?.class_name;
    return this.server.classes.find((one) => one.class_name === name);
  }

  /** The selected camera as server.json lists it; undefined for none. */
  get camera() {
    const { robot, camera } = this.selected;
    return this.camerasOf(robot).find((one) => one.name === camera);
  }

  /** Fetch the table of the selected camera. */
  async loadTable() {
    const { robot, camera } = this.selected;
    const className = this.classOf(robot)?.class_name ?? "";
    const key = JSON.stringify([className, camera]);
    if (key === this.#tableOf) return;
    this.#tableOf = key;
    this.#setTable(null);
    if (this.camera?.kind !== "omni") return;
    try {
      const table = await fetchCameraTable(className, camera);
      if (this.#tableOf === key) this.#setTable(table);
    } catch (error) {
      if (this.#tableOf === key) this.#tableOf = "";
      this.report(error);
    }
  }

  /** Fetch the table again: another server may have another file of the same robot. */
  reloadTable() {
    this.#tableOf = "";
    return this.loadTable();
  }

  /** Move the cursor to a pixel [u, v] or, with null, remove it. */
  setCursor(pixel, isHeld = false) {
    this.cursor = { pixel, isHeld: isHeld && pixel !== null };
    this.emit("cursor", this.cursor);
  }

  /** Choose settings of the pictures; null leaves one as the camera has it. */
  setVariant(changes) {
    const all = Object.entries({ ...this.variant, ...changes });
    this.variant = Object.fromEntries(all.filter(([, value]) => value !== null));
    this.emit("variant", this.variant);
  }

  /** Change the perspective view. */
  setWindow(changes) {
    this.window = { ...this.window, ...changes };
    this.emit("window", this.window);
  }

  /** Show a fault to the user for a while. */
  report(error) {
    if (!this.pictures.isOpen) return;
    showNotice(error.message);
    setTimeout(() => {
      if (this.pictures.isOpen) showNotice("");
    }, FAULT_SHOWN_MS);
  }

  /** Rotation of the mirror frame on the robot in the present frame, nine row-major numbers. */
  get mount() {
    return robotFromMirror(this.frame?.header);
  }

  /** Fields of a request for a picture with the chosen settings. */
  get variantRequest() {
    const isChosen = Object.keys(this.variant).length > 0 && this.camera?.kind === "omni";
    return isChosen ? { variant: this.variant } : {};
  }

  /** Take a frame: table and cursor are turned round where it has the other hand. */
  takeFrame(frame) {
    this.frame = frame;
    const { table, cursor } = this;
    if (table) this.#setTable(table);
    if (table !== this.table && cursor.pixel)
      this.setCursor([table.width_px - cursor.pixel[0], cursor.pixel[1]], cursor.isHeld);
  }

  #setTable(table) {
    const hand = this.frame?.header.camera_model?.Picture;
    const fitting = table && hand && hand !== table.picture ? table.turned() : table;
    if (fitting === this.table) return;
    this.table = fitting;
    this.unwarper.setTable(fitting);
    this.emit("table", fitting);
  }

  #forgetFrame() {
    this.frame?.bitmap.close();
    this.frame = null;
    this.unwarper.setFrame(null);
    this.setCursor(null);
  }
}

function defaultCamera(cameras) {
  return (cameras.find(({ kind }) => kind === "omni") ?? cameras[0])?.name ?? "";
}

/** Keep the selection among the robots there are: one's own, else the first with a camera. */
function followRobots(context) {
  const names = context.state.reply.robots.map(({ name }) => name);
  if (names.includes(context.selected.robot)) return;
  const hasCamera = (name) => context.camerasOf(name).length > 0;
  const robot = [context.own, ...names].find((name) => names.includes(name) && hasCamera(name));
  context.select(robot ?? names[0] ?? "");
}

function showNotice(text) {
  const notice = document.getElementById("notice");
  setText(notice, text);
  notice.hidden = text === "";
}

/** Show lost connections, and take up the work on new ones. */
function watchConnections(context) {
  const changed = () => {
    const is_open = context.pictures.isOpen && context.commands.isOpen;
    showNotice(is_open ? "" : "No connection to the server; trying again.");
    context.emit("connection", { is_open });
  };
  for (const connection of [context.pictures, context.commands]) {
    connection.on("open", changed);
    connection.on("close", changed);
  }
  // The server removes the robot of a closed connection.
  context.commands.on("close", () => (context.own = ""));
  let isFirst = true;
  context.pictures.on("open", async () => {
    if (isFirst) {
      isFirst = false;
      return;
    }
    try {
      const server = await fetchServer();
      // Another server, or another release of it: its own page.
      if (JSON.stringify(server) !== JSON.stringify(context.server)) location.reload();
      else await context.reloadTable();
    } catch (error) {
      context.report(error);
    }
  });
}

async function start() {
  preparePanels();
  const context = new Context(await fetchServer());
  watchConnections(context);
  // First of all handlers: views draw with the frame uploaded and the selection valid.
  context.on("state", () => followRobots(context));
  context.on("frame", ({ bitmap, file }) => context.unwarper.setFrame(bitmap, file));
  // For tests, and for the console of the browser.
  window.catoptra = { context, statistics: context.statistics };
  await createPanels(context);
  startFeed(context);
}

start().catch((error) => showNotice(`The page cannot start: ${error.message}`));
