#version 330 core
// Light that a pane of glass reflects, and the factor of the light behind it. The arithmetic is that of
// gi_core/rays/panes.py.

uniform vec3 eye_at;
uniform vec4 pane;  // internal transmittance red, green, blue; index of refraction

uniform vec3 exposure;  // as in surface.frag

in vec3 point;
in vec3 front_light;
in vec3 back_light;
layout(location = 0, index = 0) out vec4 colour;
layout(location = 0, index = 1) out vec4 factor;

void main() {
    float c = abs(dot(normalize(cross(dFdx(point), dFdy(point))), normalize(eye_at - point)));
    float n = pane.w, inside = max(sqrt(max(1.0 - (1.0 - c * c) / (n * n), 0.0)), 1e-4);
    float s = (c - n * inside) / (c + n * inside), p = (n * c - inside) / (n * c + inside);
    float F = 0.5 * (s * s + p * p);
    vec3 t = pow(pane.rgb, vec3(1.0 / inside));
    vec3 inner = (1.0 - F) * (1.0 - F) / max(1.0 - F * F * t * t, 1e-6);
    vec3 light = max(gl_FrontFacing ? front_light : back_light, 0.0);
    colour = vec4((F + inner * F * t * t) * light * exposure, 0.0);
    factor = vec4(inner * t, 1.0);
}
