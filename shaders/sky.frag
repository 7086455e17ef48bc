#version 330 core
// The sky behind a scene: patches of even light above the horizon.

uniform mat3 direction_of;  // of a place on the image, -1 to 1 along both axes, and 1
uniform vec2 pixels;        // of the image
uniform vec3 up, east, north;
uniform sampler2D dome;     // of each patch: radiance times exposure, or a display colour
uniform bool everywhere;    // black below the horizon
uniform bool compressed;    // as in surface.frag, tone_map 6
uniform float far;          // distance in units of the scene size; in pictures 1

out vec4 colour;

void main() {
    vec3 d = direction_of * vec3(2.0 * gl_FragCoord.xy / pixels - 1.0, 1.0);
    float z = dot(normalize(d), up), turn = atan(dot(d, north), dot(d, east)) / 6.2831853;
    bool above = z > 0.0;
    if (!above && !everywhere) discard;
    ivec2 size = textureSize(dome, 0), at = ivec2(vec2(fract(turn), z) * vec2(size));
    vec3 c = above ? texelFetch(dome, min(at, size - 1), 0).rgb : vec3(0.0);
    if (compressed) c /= 1.0 + max(c.r, max(c.g, c.b));
    colour = vec4(min(c, 6e4), far);
}
