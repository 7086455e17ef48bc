#version 330 core
// The sky behind a scene: even light above the horizon.

uniform mat3 direction_of;  // of a place on the image, -1 to 1 along both axes, and 1
uniform vec2 pixels;        // of the image
uniform vec3 up;
uniform vec3 light;         // radiance times exposure, or a display colour
uniform bool everywhere;    // black below the horizon
uniform bool compressed;    // as in surface.frag, tone_map 6
uniform float far;          // distance in units of the scene size; in pictures 1

out vec4 colour;

void main() {
    vec3 d = direction_of * vec3(2.0 * gl_FragCoord.xy / pixels - 1.0, 1.0);
    bool above = dot(d, up) > 0.0;
    if (!above && !everywhere) discard;
    vec3 c = above ? light : vec3(0.0);
    if (compressed) c /= 1.0 + max(c.r, max(c.g, c.b));
    colour = vec4(min(c, 6e4), far);
}
