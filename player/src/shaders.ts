/** Image formation as in gsplat (classic mode): low pass .3 pixels, alpha from 1/255 to .999, as the CPU renderer of lab/render. */
import { ROW, texelsOf } from "./pack";

/** quads an instance */
export const CHUNK = 128;

export const FULL_SCREEN = `#version 300 es
void main() { gl_Position = vec4(vec2(gl_VertexID & 1, gl_VertexID >> 1) * 4. - 1., 0., 1.); }`;

/** Reads texels of SH; unrolled, since software is slow at arrays with a computed index. */
const readSh = (texels: number) => Array.from({ length: texels }, (_, k) =>
  `  h = texelFetch(harmonics, ivec2(at.x, at.y * ${texels} + ${k}), 0);\n` + [0, 1, 2, 3].map((i) =>
    `  v = unpackHalf2x16(h[${i}]); f[${8 * k + 2 * i}] = v.x; f[${8 * k + 2 * i + 1}] = v.y;`).join("\n")).join("\n");

/** Coefficient k of a file with `rest` coefficients a channel beyond degree 0. */
const coefficient = (k: number, rest: number) =>
  k === 0 ? "vec3(f[0], f[1], f[2])" : `vec3(f[${2 + k}], f[${2 + rest + k}], f[${2 + 2 * rest + k}])`;

function colour(degree: number): string {
  const sh = (k: number) => coefficient(k, degree * (degree + 2));
  const bands = [`vec3 c = ${sh(0)} * .28209479177387814 + .5;`];
  if (degree > 0) bands.push(`if (degree > 0) c += .4886025119029199 * (-d.y * ${sh(1)} + d.z * ${sh(2)} - d.x * ${sh(3)});`);
  if (degree > 1) bands.push(`float xx = d.x * d.x, yy = d.y * d.y, zz = d.z * d.z;
  if (degree > 1) c += 1.0925484305920792 * (d.x * d.y * ${sh(4)} - d.y * d.z * ${sh(5)} - d.x * d.z * ${sh(7)})
    + .31539156525252005 * (2. * zz - xx - yy) * ${sh(6)} + .5462742152960396 * (xx - yy) * ${sh(8)};`);
  if (degree > 2) bands.push(`if (degree > 2) c += -.5900435899266435 * (d.y * (3. * xx - yy) * ${sh(9)} + d.x * (xx - 3. * yy) * ${sh(15)})
    + 2.890611442640554 * d.x * d.y * d.z * ${sh(10)} + 1.445305721320277 * d.z * (xx - yy) * ${sh(14)}
    - .4570457994644658 * (4. * zz - xx - yy) * (d.y * ${sh(11)} + d.x * ${sh(13)})
    + .3731763325901154 * d.z * (2. * zz - 3. * xx - 3. * yy) * ${sh(12)};`);
  return bands.join("\n  ");
}

/** One pixel a Gaussian: where it is in the picture, the axes of its ellipse, its colour. */
export const projection = (fileDegree: number) => `#version 300 es
precision highp float; precision highp int; precision highp usampler2D; precision highp sampler2D;
uniform usampler2D moving, harmonics; uniform sampler2D fixedPart;
uniform mat4 view; uniform vec4 lens; // focal, near, half width, half height
uniform vec3 eye; uniform int degree, count; uniform float size;
layout(location = 0) out uvec4 place; layout(location = 1) out uvec2 paint;
mat3 rotation(uint bits) {
  vec3 s = (vec3((uvec3(bits) >> uvec3(20, 10, 0)) & 1023u) - 511.) / (511. * sqrt(2.));
  float l = sqrt(max(0., 1. - dot(s, s))); uint big = bits >> 30;
  vec4 q = big == 0u ? vec4(l, s) : big == 1u ? vec4(s.x, l, s.yz) : big == 2u ? vec4(s.xy, l, s.z) : vec4(s, l);
  float w = q.x, x = q.y, y = q.z, z = q.w;
  return mat3(1. - 2. * (y * y + z * z), 2. * (x * y + w * z), 2. * (x * z - w * y),
              2. * (x * y - w * z), 1. - 2. * (x * x + z * z), 2. * (y * z + w * x),
              2. * (x * z + w * y), 2. * (y * z - w * x), 1. - 2. * (x * x + y * y));
}
void main() {
  ivec2 at = ivec2(gl_FragCoord.xy);
  uvec4 m = texelFetch(moving, at, 0); vec4 s = texelFetch(fixedPart, at, 0);
  vec3 p = uintBitsToFloat(m.xyz), t = (view * vec4(p, 1.)).xyz;
  place = uvec4(0); paint = uvec2(0);
  if (!(t.z >= lens.y) || !(s.w >= 1. / 255.) || at.y * ${ROW} + at.x >= count) return;
  s.xyz *= size;
  vec2 limit = 1.3 * lens.zw / lens.x, r = clamp(t.xy / t.z, -limit, limit);
  mat3 a = mat3(view) * rotation(m.w);
  a[0] *= s.x; a[1] *= s.y; a[2] *= s.z;
  float j = lens.x / t.z;
  vec3 ax = j * (vec3(a[0].x, a[1].x, a[2].x) - r.x * vec3(a[0].z, a[1].z, a[2].z));
  vec3 ay = j * (vec3(a[0].y, a[1].y, a[2].y) - r.y * vec3(a[0].z, a[1].z, a[2].z));
  float vx = dot(ax, ax) + .3, vy = dot(ay, ay) + .3, vxy = dot(ax, ay);
  float mid = .5 * (vx + vy), gap = length(vec2(.5 * (vx - vy), vxy));
  float l1 = mid + gap, l2 = max(mid - gap, (vx * vy - vxy * vxy) / l1);
  vec2 dir = gap < 1e-6 * mid ? vec2(1, 0) : vx > vy ? normalize(vec2(l1 - vy, vxy)) : normalize(vec2(vxy, l1 - vx));
  vec2 centre = lens.x * t.xy / t.z + lens.zw;
  float reach = sqrt(2. * log(255. * s.w) * l1);
  if (!(reach < 1e6) || any(lessThan(centre + reach, vec2(0))) || any(greaterThan(centre - reach, 2. * lens.zw))) return;
  float f[${texelsOf(fileDegree) * 8}]; uvec4 h; vec2 v;
${readSh(texelsOf(fileDegree))}
  vec3 d = normalize(p - eye);
  ${colour(fileDegree)}
  c = max(c, 0.);
  place = uvec4(floatBitsToUint(centre), packHalf2x16(dir * min(sqrt(l1), 6e4)), packHalf2x16(vec2(min(sqrt(l2), 6e4), 0.)));
  paint = uvec2(packHalf2x16(c.rg), packHalf2x16(vec2(c.b, s.w)));
}`;

/** Quads in drawing order, CHUNK an instance. */
export const SPLAT_VERTEX = `#version 300 es
precision highp float; precision highp int; precision highp usampler2D;
uniform usampler2D order, place, paint; uniform vec2 picture; uniform int visible;
out vec2 offset; flat out vec4 tint;
void main() {
  int n = gl_InstanceID * ${CHUNK} + (gl_VertexID >> 2);
  gl_Position = vec4(2, 2, 2, 1); offset = vec2(0); tint = vec4(0);
  if (n >= visible) return;
  int id = int(texelFetch(order, ivec2(n % ${ROW}, n / ${ROW}), 0).x); ivec2 at = ivec2(id % ${ROW}, id / ${ROW});
  uvec2 c = texelFetch(paint, at, 0).xy; vec2 ba = unpackHalf2x16(c.y);
  if (ba.y == 0.) return;
  tint = vec4(unpackHalf2x16(c.x), ba);
  uvec4 q = texelFetch(place, at, 0); vec2 major = unpackHalf2x16(q.z); float minor = unpackHalf2x16(q.w).x;
  offset = (vec2(gl_VertexID & 1, (gl_VertexID >> 1) & 1) * 2. - 1.) * sqrt(2. * log(255. * ba.y));
  vec2 pixel = uintBitsToFloat(q.xy) + offset.x * major + offset.y * minor * vec2(-major.y, major.x) / length(major);
  gl_Position = vec4(pixel / picture * vec2(2, -2) + vec2(-1, 1), 0., 1.);
}`;

export const SPLAT_FRAGMENT = `#version 300 es
precision highp float;
in vec2 offset; flat in vec4 tint; out vec4 pixel;
void main() {
  float alpha = min(.999, tint.a * exp(-.5 * dot(offset, offset)));
  if (alpha < 1. / 255.) discard;
  pixel = vec4(tint.rgb * alpha, alpha);
}`;
