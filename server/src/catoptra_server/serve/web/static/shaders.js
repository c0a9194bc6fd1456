/** Shaders that unwarp an omnidirectional frame; float64 twin: catoptra_client/unwarp.py. */

/** One triangle that covers the target. */
export const VERTEX_SHADER = `#version 300 es
void main() {
  vec2 corner = vec2(gl_VertexID & 1, gl_VertexID >> 1);
  gl_Position = vec4(4.0 * corner - 1.0, 0.0, 1.0);
}`;

/** Colour of the direction of each pixel of a cylinder or of a perspective view. */
export const FRAGMENT_SHADER = `#version 300 es
precision highp float;
precision highp int;
precision highp sampler2D;

uniform sampler2D frame;       // filtered linearly
uniform ivec2 frameSize;
uniform sampler2D radii;       // and decentring of equidistant angles; each with the next one
uniform float minTheta;
uniform float maxTheta;
uniform vec2 centre;
uniform mat2 azimuthMatrix;
uniform mat3x2 decentring;
uniform vec2 row;              // row of the target = row.x + row.y * gl_FragCoord.y
uniform sampler2D azimuths;    // cosine and sine of each column of a cylinder
uniform bool isCylinder;
uniform vec2 slope;            // slope of a row = slope.x + slope.y * row
uniform mat3 viewAxes;         // columns: forward, right, down
uniform mat3 mirrorFromRobot;
uniform vec3 view;             // focal length, centre of the view
out vec4 colour;

// Arc tangent of 0 <= x <= 1 within 2e-8: Abramowitz & Stegun, 4.4.49. The built-in one may err by
// 0.1 px (Vulkan allows 4096 ulp).
float arcTangent(float x) {
  float s = x * x;
  return x * (1.0 + s * (-0.3333314528 + s * (0.1999355085 + s * (-0.1420889944
      + s * (0.1065626393 + s * (-0.0752896400 + s * (0.0429096138
      + s * (-0.0161657367 + s * 0.0028662257))))))));
}

// Incidence angle, 0 to pi, of a direction at distance rho >= 0 from the axis.
float incidence(float rho, float z) {
  float a = abs(z);
  float angle = rho <= a ? arcTangent(rho / a) : 1.5707963267948966 - arcTangent(a / rho);
  return z >= 0.0 ? angle : 3.141592653589793 - angle;
}

vec2 radiiFromTheta(float theta) {
  int last = textureSize(radii, 0).x - 1;
  float position = theta / maxTheta * float(last);
  int i = clamp(int(position), 0, last - 1);
  vec4 neighbours = texelFetch(radii, ivec2(i, 0), 0);
  return mix(neighbours.xy, neighbours.zw, position - float(i));
}

// Bilinear interpolation with pixel centres at +0.5. Within half a pixel of the border it tends to
// black, as BORDER_CONSTANT of OpenCV; the texture itself is clamped there.
vec3 sampleFrame(vec2 pixel) {
  vec2 size = vec2(frameSize);
  vec2 inside = clamp(pixel + 0.5, 0.0, 1.0) * clamp(size - pixel + 0.5, 0.0, 1.0);
  return inside.x * inside.y * texture(frame, pixel / size).rgb;
}

// In the axes of the robot.
vec3 directionOf(vec2 target) {
  if (isCylinder) {
    vec2 level = texelFetch(azimuths, ivec2(int(target.x), 0), 0).rg;
    return vec3(level, slope.x + slope.y * target.y);
  }
  return viewAxes * vec3(view.x, target - view.yz);
}

void main() {
  vec2 target = vec2(gl_FragCoord.x, row.x + row.y * gl_FragCoord.y);
  vec3 direction = mirrorFromRobot * directionOf(target);
  float rho = length(direction.xy);
  float theta = incidence(rho, direction.z);
  vec2 level = rho > 0.0 ? direction.xy / rho : vec2(1.0, 0.0);
  vec2 radius = radiiFromTheta(theta);
  vec2 pixel = centre + radius.x * (azimuthMatrix * level)
      + radius.y * (decentring * vec3(level.x * level, level.y * level.y));
  bool valid = theta >= minTheta && theta <= maxTheta && all(greaterThanEqual(pixel, vec2(0.0)))
      && all(lessThanEqual(pixel, vec2(frameSize)));
  colour = vec4(valid ? sampleFrame(pixel) : vec3(0.0), 1.0);
}`;
