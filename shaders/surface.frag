#version 330 core
// Chooses the side that is seen, then exposure, tone map, sRGB: once each, in this order.
// app/draw/tonemap.py does the same arithmetic for pictures without a window.

uniform vec3 exposure;   // factor: 2^EV times the gain of the white balance
uniform int tone_map;    // 0 clip, 1 Reinhard, 2 ACES, 3 none: display colours, 4 false colours
uniform vec3 scale;      // of false colours: low, high, 1 if logarithmic
uniform vec3 map[33];    // display colours from low to high
uniform float lines[16];  // values of the isolines
uniform int line_count;
uniform vec3 line_look;  // width in pixels, opacity, position on the scale from which lines are black
uniform vec3 unlit;      // display colour of a side that has no light by definition

centroid in vec4 front_radiance;  // times its weight; weight
centroid in vec4 back_radiance;
centroid in vec3 front_gloss;  // above the texture, times its weight
centroid in vec3 back_gloss;
out vec4 colour;
#ifdef TEXTURED
uniform sampler2D image;    // sRGB, decoded before it is filtered
uniform vec2 mirrored;      // 1 where the image is mirrored beyond its edges
uniform float brightest;    // reflectance at most
uniform vec3 emission;      // of the front, which the texture does not colour
uniform float painted;      // 0: only the holes of the texture count
in vec2 uv;
#endif

vec3 tone_mapped(vec3 c) {
    if (tone_map == 1) c = c / (1.0 + dot(c, vec3(0.2126, 0.7152, 0.0722)));
    if (tone_map == 2) { c *= 0.6; c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14); }
    return clamp(c, 0.0, 1.0);
}

vec3 srgb(vec3 c) {
    return mix(1.055 * pow(max(c, 0.0031308), vec3(1.0 / 2.4)) - 0.055, 12.92 * c, vec3(lessThanEqual(c, vec3(0.0031308))));
}

float irradiance(vec3 radiance) {
    return 3.14159265 * dot(radiance, vec3(0.2126, 0.7152, 0.0722));
}

// slope: change of E per pixel
vec3 false_colour(vec3 radiance, float slope) {
    float E = irradiance(radiance);
    float ratio = scale.z > 0.5 ? log(max(E, 1e-30) / scale.x) / log(scale.y / scale.x) : (E - scale.x) / (scale.y - scale.x);
    float at = 32.0 * clamp(ratio, 0.0, 1.0);
    int k = min(int(at), 31);
    vec3 c = mix(map[k], map[k + 1], at - float(k));
    float off = 1e30;
    for (int i = 0; i < line_count; i++) off = min(off, abs(E - lines[i]));
    float covered = slope > 0.0 ? clamp(0.5 * line_look.x + 0.5 - off / slope, 0.0, 1.0) : 0.0;
    return mix(c, vec3(at < 32.0 * line_look.z ? 1.0 : 0.0), covered * line_look.y);
}

void main() {
    vec4 seen = gl_FrontFacing ? front_radiance : back_radiance;
    vec3 radiance = seen.rgb / seen.a;
    float E = irradiance(radiance);  // of neighbours too: before any branch
    float slope = length(vec2(dFdx(E), dFdy(E)));
#ifdef TEXTURED
    vec2 at = mix(uv, 1.0 - abs(mod(uv, 2.0) - 1.0), mirrored);
#ifdef CUT_OUT
    // As sharp from afar as near by: the smaller copies would thin leaves out.
    if (textureLod(image, at, 0.0).a < 0.5) discard;
#endif
    vec3 paint = mix(vec3(1.0), min(texture(image, at).rgb, brightest), painted);
    if (radiance.r >= -0.5) radiance = paint * radiance + (gl_FrontFacing ? painted * emission : vec3(0.0));
#endif
    if (radiance.r >= -0.5 && tone_map < 3) radiance += (gl_FrontFacing ? front_gloss : back_gloss) / seen.a;
    if (radiance.r < -0.5) {
        colour = vec4(unlit, 1.0);
    } else if (tone_map == 3) {
        colour = vec4(radiance, 1.0);
    } else if (tone_map == 4) {
        colour = vec4(false_colour(radiance, slope), 1.0);
    } else {
        colour = vec4(srgb(tone_mapped(max(radiance, 0.0) * exposure)), 1.0);
    }
}
