/**
 * Unwarping of the present frame by WebGL2, in a worker: creating a context, compiling, and
 * rendering without a graphics processor take longer than a page may stand still.
 *
 * One context for all views: a frame is uploaded once, and one place restores a lost context.
 */

import { FRAGMENT_SHADER, VERTEX_SHADER } from "./shaders.js";
import { NO_TURN, viewAxes } from "./transforms.js";

const FRAME_UNIT = 0;
const RADII_UNIT = 1;
const AZIMUTHS_UNIT = 2;

/** Renders views of the frame of a camera by its table. */
export class UnwarpRenderer {
  #canvas = new OffscreenCanvas(1, 1);
  #gl;
  #uniforms = {};
  #frame = null;
  #table = null;
  #azimuthsOf = "";
  #isUploaded = false;
  #onRestored;

  /** `onRestored()`: the views must be drawn again. @throws {Error} without WebGL2 */
  constructor(onRestored) {
    this.#onRestored = onRestored;
    const options = { antialias: false, depth: false, powerPreference: "low-power" };
    this.#gl = this.#canvas.getContext("webgl2", options);
    if (!this.#gl) throw new Error("this browser offers no WebGL2");
    this.#canvas.addEventListener("webglcontextlost", (event) => event.preventDefault());
    this.#canvas.addEventListener("webglcontextrestored", () => this.#restore());
    this.#setUp();
  }

  /** Whether pictures can be drawn: not between the loss of the context and its return. */
  get isReady() {
    return !this.#gl.isContextLost() && this.#frame !== null && this.#matches();
  }

  /** Name of the graphics processor or of the program in its place; "" if the browser hides it. */
  get name() {
    const gl = this.#gl;
    const extension = gl.getExtension("WEBGL_debug_renderer_info");
    return gl.getParameter(extension?.UNMASKED_RENDERER_WEBGL ?? gl.RENDERER) ?? "";
  }

  /** Take the frame to show from now on, and close the one before. */
  setFrame(bitmap) {
    this.#frame?.close();
    this.#frame = bitmap;
    this.#isUploaded = false;
  }

  /** Take the model of the camera; null for a camera that cannot be unwarped. */
  setTable(table) {
    this.#table = table;
    if (table !== null && !this.#gl.isContextLost()) this.#uploadTable();
  }

  /**
   * Bitmap of a view: a cylinder, as of chooseCylinder, or a perspective view {width_px, height_px,
   * fov_rad, yaw_rad, pitch_rad}, in the axes of the robot by its robot_from_mirror: nine row-major
   * numbers, or in those of the mirror frame without.
   */
  draw(view) {
    const [width, height] = sizeOf(view);
    if (this.#canvas.width !== width) this.#canvas.width = width;
    if (this.#canvas.height !== height) this.#canvas.height = height;
    this.#render(view, [height, -1]);
    return this.#canvas.transferToImageBitmap();
  }

  /** RGBA of a view, rows from the top. @throws {Error} if the context is lost meanwhile */
  async read(view) {
    const gl = this.#gl;
    const [width, height] = sizeOf(view);
    const target = gl.createRenderbuffer();
    gl.bindRenderbuffer(gl.RENDERBUFFER, target);
    gl.renderbufferStorage(gl.RENDERBUFFER, gl.RGBA8, width, height);
    const framebuffer = gl.createFramebuffer();
    gl.bindFramebuffer(gl.FRAMEBUFFER, framebuffer);
    gl.framebufferRenderbuffer(gl.FRAMEBUFFER, gl.COLOR_ATTACHMENT0, gl.RENDERBUFFER, target);
    // A framebuffer's first row is the first that is read: no flip.
    this.#render(view, [0, 1]);
    // Into a buffer: the driver would stop everything until it had the pixels.
    const pixels = new Uint8ClampedArray(4 * width * height);
    const buffer = gl.createBuffer();
    gl.bindBuffer(gl.PIXEL_PACK_BUFFER, buffer);
    gl.bufferData(gl.PIXEL_PACK_BUFFER, pixels.byteLength, gl.STREAM_READ);
    gl.readPixels(0, 0, width, height, gl.RGBA, gl.UNSIGNED_BYTE, 0);
    gl.bindFramebuffer(gl.FRAMEBUFFER, null);
    gl.deleteFramebuffer(framebuffer);
    gl.deleteRenderbuffer(target);
    try {
      await this.#finish();
      gl.getBufferSubData(gl.PIXEL_PACK_BUFFER, 0, pixels);
    } finally {
      gl.bindBuffer(gl.PIXEL_PACK_BUFFER, null);
      gl.deleteBuffer(buffer);
    }
    return pixels;
  }

  /** Wait until all commands are executed. */
  async #finish() {
    const gl = this.#gl;
    const sync = gl.fenceSync(gl.SYNC_GPU_COMMANDS_COMPLETE, 0);
    gl.flush();
    try {
      while (gl.clientWaitSync(sync, 0, 0) === gl.TIMEOUT_EXPIRED) {
        await new Promise((resolve) => setTimeout(resolve, 1));
      }
    } finally {
      gl.deleteSync(sync);
    }
    if (gl.isContextLost()) throw new Error("the graphics context is lost");
  }

  /** Whether the table is that of the frame: after a change one of them may be older. */
  #matches() {
    const [table, frame] = [this.#table, this.#frame];
    return table?.width_px === frame.width && table?.height_px === frame.height;
  }

  #restore() {
    this.#setUp();
    this.#isUploaded = false;
    if (this.#table !== null) this.#uploadTable();
    this.#onRestored();
  }

  #setUp() {
    const gl = this.#gl;
    const program = gl.createProgram();
    for (const [kind, source] of [
      [gl.VERTEX_SHADER, VERTEX_SHADER],
      [gl.FRAGMENT_SHADER, FRAGMENT_SHADER],
    ]) {
      const shader = gl.createShader(kind);
      gl.shaderSource(shader, source);
      gl.compileShader(shader);
      gl.attachShader(program, shader);
    }
    gl.linkProgram(program);
    if (!gl.getProgramParameter(program, gl.LINK_STATUS) && !gl.isContextLost()) {
      const logs = gl.getAttachedShaders(program).map((shader) => gl.getShaderInfoLog(shader));
      throw new Error(`the shader cannot be used: ${gl.getProgramInfoLog(program)} ${logs}`);
    }
    gl.useProgram(program);
    const numUniforms = gl.getProgramParameter(program, gl.ACTIVE_UNIFORMS) ?? 0;
    for (let i = 0; i < numUniforms; i += 1) {
      const { name } = gl.getActiveUniform(program, i);
      this.#uniforms[name] = gl.getUniformLocation(program, name);
    }
    gl.pixelStorei(gl.UNPACK_COLORSPACE_CONVERSION_WEBGL, gl.NONE);
    this.#createTexture(FRAME_UNIT, gl.LINEAR);
    this.#createTexture(RADII_UNIT, gl.NEAREST);
    this.#createTexture(AZIMUTHS_UNIT, gl.NEAREST);
    gl.uniform1i(this.#uniforms.frame, FRAME_UNIT);
    gl.uniform1i(this.#uniforms.radii, RADII_UNIT);
    gl.uniform1i(this.#uniforms.azimuths, AZIMUTHS_UNIT);
    this.#azimuthsOf = "";
  }

  /** A texture without mipmaps; black before the first upload. */
  #createTexture(unit, filter) {
    const gl = this.#gl;
    gl.activeTexture(gl.TEXTURE0 + unit);
    gl.bindTexture(gl.TEXTURE_2D, gl.createTexture());
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MIN_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_MAG_FILTER, filter);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_S, gl.CLAMP_TO_EDGE);
    gl.texParameteri(gl.TEXTURE_2D, gl.TEXTURE_WRAP_T, gl.CLAMP_TO_EDGE);
    const black = new Uint8Array(4);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, 1, 1, 0, gl.RGBA, gl.UNSIGNED_BYTE, black);
  }

  #uploadTable() {
    const [gl, table] = [this.#gl, this.#table];
    const { radius_px, decentring_px, decentring_matrix } = table;
    // Each radius with the next one: one access instead of two, since floats are not filtered.
    const last = radius_px.length - 1;
    const radii = new Float32Array(4 * (last + 1));
    for (let i = 0; i <= last; i += 1) {
      const next = Math.min(i + 1, last);
      const squares = decentring_px ? [decentring_px[i], decentring_px[next]] : [0, 0];
      radii.set([radius_px[i], squares[0], radius_px[next], squares[1]], 4 * i);
    }
    gl.activeTexture(gl.TEXTURE0 + RADII_UNIT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA32F, last + 1, 1, 0, gl.RGBA, gl.FLOAT, radii);
    const [e, f, g, h, i, j] = decentring_matrix ?? [0, 0, 0, 0, 0, 0];
    gl.uniformMatrix3x2fv(this.#uniforms.decentring, false, [e, h, f, i, g, j]);
    gl.uniform1f(this.#uniforms.minTheta, table.min_theta_rad);
    gl.uniform1f(this.#uniforms.maxTheta, table.max_theta_rad);
    gl.uniform2fv(this.#uniforms.centre, table.centre_px);
    // Rows there, columns here.
    const [a, b, c, d] = table.azimuth_matrix;
    gl.uniformMatrix2fv(this.#uniforms.azimuthMatrix, false, [a, c, b, d]);
  }

  #uploadFrame() {
    const [gl, frame] = [this.#gl, this.#frame];
    gl.activeTexture(gl.TEXTURE0 + FRAME_UNIT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RGBA, gl.RGBA, gl.UNSIGNED_BYTE, frame);
    gl.uniform2i(this.#uniforms.frameSize, frame.width, frame.height);
    this.#isUploaded = true;
  }

  /** Cosines and sines of a cylinder's columns, in float64: built-in ones may err by 5e-4. */
  #uploadAzimuths({ columns, seam_azimuth_rad }) {
    const key = `${columns} ${seam_azimuth_rad}`;
    if (this.#azimuthsOf === key) return;
    this.#azimuthsOf = key;
    const gl = this.#gl;
    const azimuths = new Float32Array(2 * columns);
    for (let i = 0; i < columns; i += 1) {
      const azimuth_rad = seam_azimuth_rad + (2 * Math.PI * (i + 0.5)) / columns;
      azimuths[2 * i] = Math.cos(azimuth_rad);
      azimuths[2 * i + 1] = Math.sin(azimuth_rad);
    }
    gl.activeTexture(gl.TEXTURE0 + AZIMUTHS_UNIT);
    gl.texImage2D(gl.TEXTURE_2D, 0, gl.RG32F, columns, 1, 0, gl.RG, gl.FLOAT, azimuths);
  }

  #render(view, row) {
    const [gl, uniforms] = [this.#gl, this.#uniforms];
    const [width, height] = sizeOf(view);
    if (!this.#isUploaded) this.#uploadFrame();
    const isCylinder = "columns" in view;
    gl.uniform1i(uniforms.isCylinder, Number(isCylinder));
    if (isCylinder) {
      this.#uploadAzimuths(view);
      const slope_per_row = (view.bottom_slope - view.top_slope) / view.rows;
      gl.uniform2f(uniforms.slope, view.top_slope, slope_per_row);
    } else {
      const { forward, right, down } = viewAxes(view.yaw_rad, view.pitch_rad);
      gl.uniformMatrix3fv(uniforms.viewAxes, false, [...forward, ...right, ...down]);
      const focalLength_px = (0.5 * width) / Math.tan(0.5 * view.fov_rad);
      gl.uniform3f(uniforms.view, focalLength_px, 0.5 * width, 0.5 * height);
    }
    // Rows there, columns here: read as columns, the rotation is its inverse.
    gl.uniformMatrix3fv(uniforms.mirrorFromRobot, false, view.robot_from_mirror ?? NO_TURN);
    gl.uniform2f(uniforms.row, row[0], row[1]);
    gl.viewport(0, 0, width, height);
    gl.drawArrays(gl.TRIANGLES, 0, 3);
  }
}

function sizeOf(view) {
  return "columns" in view ? [view.columns, view.rows] : [view.width_px, view.height_px];
}
