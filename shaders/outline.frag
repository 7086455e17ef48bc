#version 330 core
// Draws a soft line round the marked pixels, on their outside: the object itself keeps its light.

uniform sampler2D mask;
uniform vec4 line;    // display colour, opacity
uniform float width;  // pixels

out vec4 colour;

void main() {
    ivec2 here = ivec2(gl_FragCoord.xy);
    ivec2 last = textureSize(mask, 0) - 1;
    if (texelFetch(mask, here, 0).r > 0.5) discard;
    float near = 0.0;
    int reach = int(ceil(width));
    for (int y = -reach; y <= reach; y++) {
        for (int x = -reach; x <= reach; x++) {
            float away = length(vec2(x, y));
            if (texelFetch(mask, clamp(here + ivec2(x, y), ivec2(0), last), 0).r > 0.5)
                near = max(near, clamp(width + 0.5 - away, 0.0, 1.0));
        }
    }
    if (near == 0.0) discard;
    colour = vec4(line.rgb, line.a * near);
}
