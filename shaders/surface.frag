#version 330 core
// Chooses the side that is seen, then exposure, tone map, sRGB: once each, in this order.
// app/draw/tonemap.py does the same arithmetic for pictures without a window.
// TONE_MAP: 0 clip, 1 Reinhard, 2 ACES, 3 none: display colours, 4 false colours, 5 a reflection: linear,
// 6: c / (1 + max c), 7 AgX, 8 Khronos PBR Neutral, 9 none yet: linear.

uniform vec3 exposure;   // factor: 2^EV times the gain of the white balance
uniform vec3 scale;      // of false colours: low, high, 1 if logarithmic
uniform bool of_luminance;  // the scale is of radiance, else of irradiance: colours are E / pi
uniform vec3 map[33];    // display colours from low to high
uniform float lines[16];  // values of the isolines
uniform int line_count;
uniform vec3 line_look;  // width in pixels, opacity, position on the scale from which lines are black
uniform vec3 unlit;      // display colour of a side that has no light by definition

#ifndef RESOLVED
centroid in vec4 front_radiance;  // times its weight; weight
centroid in vec4 back_radiance;
#ifdef GLOSS
centroid in vec3 front_gloss;  // above the texture, times its weight
centroid in vec3 back_gloss;
#endif
#endif
out vec4 colour;
uniform float reach;  // scene size [m]
#ifdef TEXTURED
uniform sampler2D image;    // sRGB, decoded before it is filtered
uniform vec2 mirrored;      // 1 where the image is mirrored beyond its edges
uniform float brightest;    // reflectance at most
uniform vec3 emission;      // of the front, which the texture does not colour
uniform float painted;      // 0: only the holes of the texture count
in vec2 uv;
#endif

#ifdef SHARP
// Sharp gloss: half vectors of the lobe, each with a look into an image of the reflection; app/draw/reflected.py traces
// rays instead. Images hold radiance times exposure, and depth in units of the scene size (app/draw/gl_mirrors.py).
in vec3 point;
in vec3 shading;
in vec3 grain;
uniform mat4 view_projection;
uniform vec3 eye_at;
uniform vec2 picture;       // its pixels
uniform bool planar;
uniform bool compressed;        // the plane's image holds c / (1 + max c)
uniform sampler2D plane_image;
uniform samplerCube surroundings;
uniform vec3 centre;        // of the probe
uniform vec3 albedo[17];    // of the lobe by the cosine of the view
uniform vec3 taps[16];      // slopes of half vectors along the grain and across it; width that the ray stands for
uniform int count;          // of taps
uniform vec4 lobe;          // F0 red, green, blue; F90
uniform float alpha;        // < 0: a table
uniform vec4 lamp_at[16];   // lights without a surface: position, 1; or direction towards the light, 0
uniform vec3 lamp_value[16];
uniform int lamp_count;
in vec4 arriving[4];        // strength of each light, 0 in its shadow
vec3 looks[4];              // of a pixel into a probe, in place of the samples that other edges have
bool has_looks = false;

// How far q, relative to the centre, lies beyond the surroundings in its direction.
float beyond_surroundings(vec3 q) {
    vec3 a = abs(q);
    float far = length(q);
    return far - textureLod(surroundings, q, 0.0).a * reach * far / max(a.x, max(a.y, a.z));
}

// Where a ray from r, relative to the centre, leaves the surroundings: steps of double length, then regula falsi.
vec3 leaving(vec3 r, vec3 d) {
    float low = 0.0, high = reach / 64.0, inside = beyond_surroundings(r), outside = beyond_surroundings(r + high * d);
    bool hidden = inside > 1e-2 * reach;  // the ray starts behind what the centre sees
    inside = min(inside, -1e-4 * reach);
    for (int k = 0; k < 7 && (hidden || outside < 0.0); ++k) {
        hidden = hidden && outside >= 0.0;
        low = high;
        inside = outside;
        high *= 2.0;
        outside = beyond_surroundings(r + high * d);
    }
    if (hidden || outside < 0.0) return r + high * d;
    for (int k = 0; k < 4; ++k) {
        float middle = mix(low, high, clamp(inside / (inside - outside), 0.05, 0.95));
        float there = beyond_surroundings(r + middle * d);
        if (there < 0.0) {
            low = middle;
            inside = there;
        } else {
            high = middle;
            outside = there;
        }
    }
    return r + mix(low, high, clamp(inside / (inside - outside), 0.0, 1.0)) * d;
}

float smith(float cosine) {
    float tan2 = max(0.0, 1.0 - cosine * cosine) / (cosine * cosine);
    return 0.5 * (sqrt(1.0 + alpha * alpha * tan2) - 1.0);
}

// Gloss f cos for light from d; axes: tangent, bitangent, normal. Tables: the taps, each as wide as it stands for.
vec3 sent_from(vec3 d, mat3 axes, vec3 to_eye, vec3 share) {
    float at_light = dot(d, axes[2]), at_eye = max(dot(to_eye, axes[2]), 1e-3);
    if (alpha >= 0.0) {
        vec3 h = normalize(d + to_eye);
        float cos_h = dot(h, axes[2]), a2 = alpha * alpha, t = cos_h * cos_h * (a2 - 1.0) + 1.0;
        float f = a2 / (3.14159265 * t * t) / (4.0 * at_eye * (1.0 + smith(at_eye) + smith(at_light)));
        return f * (lobe.rgb + (lobe.a - lobe.rgb) * pow(max(0.0, 1.0 - dot(d, h)), 5.0));
    }
    float sum = 0.0;
    for (int j = 0; j < count; ++j) {
        vec3 h = normalize(axes * vec3(taps[j].xy, 1.0)), off = d - reflect(-to_eye, h);
        float wide2 = taps[j].z * taps[j].z * max(dot(to_eye, h), 0.1);
        sum += exp(-3.14159265 * dot(off, off) / wide2) / wide2;
    }
    return share * sum / float(count);
}

vec3 highlights(mat3 axes, vec3 flat_normal, vec3 to_eye, vec3 share) {
    vec3 sum = vec3(0.0);
    for (int k = 0; k < lamp_count; ++k) {
        vec3 way = lamp_at[k].xyz - lamp_at[k].w * point;
        float far2 = dot(way, way), strength = arriving[k / 4][k % 4] / far2;
        vec3 d = way * inversesqrt(far2);
        if (strength > 0.0 && dot(d, axes[2]) > 0.0 && dot(d, flat_normal) > 0.0)
            sum += strength * lamp_value[k] * sent_from(d, axes, to_eye, share);
    }
    return sum;
}

vec3 reflected(vec3 flat_normal) {
    vec3 to_eye = eye_at - point;
    float distance_to_eye = length(to_eye);
    to_eye /= distance_to_eye;
    vec3 n = normalize(shading) * (gl_FrontFacing ? 1.0 : -1.0);
    vec3 t = grain - n * dot(grain, n);
    t = dot(t, t) > 1e-8 ? normalize(t) : normalize(abs(n.x) < 0.5 ? cross(n, vec3(1, 0, 0)) : cross(n, vec3(0, 1, 0)));
    vec3 s = cross(n, t);
    float at_eye = clamp(dot(to_eye, n), 0.0, 1.0);
    int k = min(int(16.0 * at_eye), 15);
    vec3 share = mix(albedo[k], albedo[k + 1], 16.0 * at_eye - float(k));

    vec3 mean = reflect(-to_eye, n);
    vec3 r = point - centre, first = vec3(0.0);
    vec2 here = gl_FragCoord.xy / picture;
    float beyond = 0.0;
    if (planar) {
        beyond = distance_to_eye * max(textureLod(plane_image, here, 0.0).a * reach * gl_FragCoord.w - 1.0, 0.0);
    } else {
        first = leaving(r, mean);
    }
    if (count == 1 && planar) {
        vec3 c = textureLod(plane_image, here, 0.0).rgb;
        return share * (compressed ? c / max(1.0 - max(c.r, max(c.g, c.b)), 1e-4) : c);
    }
    if (count == 1) {
        // Curved mirrors show lamps as lines thinner than a pixel: four looks, as far apart as samples of a pixel.
        vec3 right = dFdx(first), up = dFdy(first), c = vec3(0.0);
        for (int j = 0; j < 4; ++j) {
            vec2 part = vec2(j & 1, j >> 1) - 0.5;
            part = 0.5 * part + 0.25 * vec2(part.y, -part.x);
            vec3 look = share * textureLod(surroundings, first + part.x * right + part.y * up, 0.0).rgb;
            looks[j] = look;
            c += 0.25 * look / (1.0 + max(look.r, max(look.g, look.b)));  // so that lamps end as smoothly as other edges
        }
        has_looks = true;
        return c / max(1.0 - max(c.r, max(c.g, c.b)), 1e-4);
    }
    float around = length(first - r);  // of the surroundings, for all taps
    vec3 sum = vec3(0.0);
    for (int j = 0; j < count; ++j) {
        vec3 h = normalize(n + taps[j].x * t + taps[j].y * s);
        vec3 d = reflect(-to_eye, h);
        d -= 2.0 * min(dot(d, flat_normal), 0.0) * flat_normal;
        float wide = taps[j].z * sqrt(max(dot(to_eye, h), 0.1));
        if (planar) {
            vec3 through = d - 2.0 * dot(d, flat_normal) * flat_normal;
            vec4 along = view_projection * vec4(through, 0.0), from = view_projection * vec4(point, 1.0);
            float far = beyond;
            for (int k = 0; k < 2; ++k) {
                vec4 at = from + far * along;
                float depth = textureLod(plane_image, 0.5 * at.xy / at.w + 0.5, 0.0).a * reach;
                far = abs(along.w) > 0.1 ? clamp((depth - from.w) / along.w, 0.25 * far, 4.0 * far) : far;
            }
            vec4 at = from + far * along;
            float pixel = 2.0 / (picture.y * length(vec3(view_projection[0][1], view_projection[1][1], view_projection[2][1])));
            float lod = log2(max(far * wide / ((distance_to_eye + far) * pixel), 1.0));
            sum += textureLod(plane_image, 0.5 * at.xy / at.w + 0.5, lod).rgb;
        } else {
            float lod = log2(max(wide * float(textureSize(surroundings, 0).x) / 1.57, 1.0));
            sum += textureLod(surroundings, r + around * d, lod).rgb;
        }
    }
    return share * sum / float(count) + exposure * highlights(mat3(t, s, n), flat_normal, to_eye, share);
}
#endif

vec3 agx(vec3 c) {
    c = mat3(0.842479062253094, 0.0423282422610123, 0.0423756549057051,
             0.0784335999999992, 0.878468636469772, 0.0784336,
             0.0792237451477643, 0.0791661274605434, 0.879142973793104) * c;
    vec3 x = clamp((log2(max(c, exp2(-12.47393))) + 12.47393) / (4.026069 + 12.47393), 0.0, 1.0);
    x = (((((15.5 * x - 40.14) * x + 31.96) * x - 6.868) * x + 0.4298) * x + 0.1191) * x - 0.00232;
    x = mat3(1.19687900512017, -0.0528968517574562, -0.0529716355144438,
             -0.0980208811401368, 1.15190312990417, -0.0980434501171241,
             -0.0990297440797205, -0.0989611768448433, 1.15107367264116) * x;
    return pow(clamp(x, 0.0, 1.0), vec3(2.2));
}

vec3 neutral(vec3 c) {
    float low = min(c.r, min(c.g, c.b)), start = 0.8 - 0.04, d = 1.0 - start;
    c -= low < 0.08 ? low - 6.25 * low * low : 0.04;
    float peak = max(c.r, max(c.g, c.b));
    if (peak < start) return c;
    float highest = 1.0 - d * d / (peak + d - start);
    return mix(c * highest / peak, vec3(highest), 1.0 - 1.0 / (0.15 * (peak - highest) + 1.0));
}

vec3 tone_mapped(vec3 c) {
    if (TONE_MAP == 7) c = agx(c);
    if (TONE_MAP == 8) c = neutral(c);
    if (TONE_MAP == 1) c = c / (1.0 + dot(c, vec3(0.2126, 0.7152, 0.0722)));
    if (TONE_MAP == 2) { c *= 0.6; c = c * (2.51 * c + 0.03) / (c * (2.43 * c + 0.59) + 0.14); }
    return clamp(c, 0.0, 1.0);
}

vec3 srgb(vec3 c) {
    return mix(1.055 * pow(max(c, 0.0031308), vec3(1.0 / 2.4)) - 0.055, 12.92 * c, vec3(lessThanEqual(c, vec3(0.0031308))));
}

// Of the scale of false colours.
float value_of(vec3 radiance) {
    return (of_luminance ? 1.0 : 3.14159265) * dot(radiance, vec3(0.2126, 0.7152, 0.0722));
}

// slope: change of the value per pixel
vec3 false_colour(vec3 radiance, float slope) {
    float E = value_of(radiance);
    float ratio = scale.z > 0.5 ? log(max(E, 1e-30) / scale.x) / log(scale.y / scale.x) : (E - scale.x) / (scale.y - scale.x);
    float at = 32.0 * clamp(ratio, 0.0, 1.0);
    int k = min(int(at), 31);
    vec3 c = mix(map[k], map[k + 1], at - float(k));
    float off = 1e30;
    for (int i = 0; i < line_count; i++) off = min(off, abs(E - lines[i]));
    float covered = slope > 0.0 ? clamp(0.5 * line_look.x + 0.5 - off / slope, 0.0, 1.0) : 0.0;
    return mix(c, vec3(at < 32.0 * line_look.z ? 1.0 : 0.0), covered * line_look.y);
}

#ifdef RESOLVED
// The picture of a scene with panes: light that is drawn, and multiplied by panes, before the tone map.
#if SAMPLES > 1
uniform sampler2DMS light;  // radiance times exposure, alpha 1; the share that panes leave of the background, alpha 0
#else
uniform sampler2D light;
#endif
uniform vec3 background;  // display colour

void main() {
    vec3 sum = vec3(0.0);
    for (int k = 0; k < SAMPLES; ++k) {
        vec4 c = texelFetch(light, ivec2(gl_FragCoord.xy), k);
        sum += c.a < 0.5 ? c.rgb * background : c.r < 0.0 ? unlit : srgb(tone_mapped(c.rgb));
    }
    colour = vec4(sum / float(SAMPLES), 1.0);
}
#else
#ifdef TEXTURED
// Return the mean of the image over a pixel: samples along the longer side of its footprint, as wide as the shorter.
vec3 filtered(vec2 at) {
    vec2 a = dFdx(at), b = dFdy(at), texels = vec2(textureSize(image, 0));
    float of_a = length(a * texels), of_b = length(b * texels), wide = max(of_a, of_b);
    float samples = clamp(ceil(wide / max(min(of_a, of_b), 1e-6)), 1.0, wide > 1.0 ? 8.0 : 1.0);
    vec2 along = (of_a > of_b ? a : b) / samples;
    float level = log2(max(wide / samples, 1e-6));
    vec3 sum = vec3(0.0);
    for (float k = 0.5 - 0.5 * samples; k < 0.5 * samples; k += 1.0) sum += textureLod(image, at + k * along, level).rgb;
    return sum / samples;
}
#endif
void main() {
    vec4 seen = gl_FrontFacing ? front_radiance : back_radiance;
    vec3 radiance = seen.rgb / seen.a;
    float E = value_of(radiance);  // of neighbours too: before any branch
    float slope = length(vec2(dFdx(E), dFdy(E)));
#ifdef TEXTURED
    vec2 at = mix(uv, 1.0 - abs(mod(uv, 2.0) - 1.0), mirrored);
#ifdef CUT_OUT
    // As sharp from afar as near by: the smaller copies would thin leaves out.
    if (textureLod(image, at, 0.0).a < 0.5) discard;
#endif
    vec3 paint = mix(vec3(1.0), min(filtered(at), brightest), painted);
    if (radiance.r >= -0.5) radiance = paint * radiance + (gl_FrontFacing ? painted * emission : vec3(0.0));
#endif
#ifdef SHARP
    vec3 flat_normal = normalize(cross(dFdx(point), dFdy(point)));
    if (dot(flat_normal, eye_at - point) < 0.0) flat_normal = -flat_normal;
    vec3 more = reflected(flat_normal);
#else
    vec3 more = vec3(0.0);
#ifdef GLOSS
    if (radiance.r >= -0.5) radiance += (gl_FrontFacing ? front_gloss : back_gloss) / seen.a;
#endif
#endif
    if (TONE_MAP == 5 || TONE_MAP == 6) {
        vec3 c = min(max(radiance, 0.0) * exposure + more, 6e4);
        if (TONE_MAP == 6) c /= 1.0 + max(c.r, max(c.g, c.b));
        colour = vec4(c, min(1.0 / (gl_FragCoord.w * reach), 6e4));
    } else if (TONE_MAP == 9) {
        colour = vec4(radiance.r < -0.5 ? vec3(-1.0) : min(max(radiance, 0.0) * exposure + more, 6e4), 1.0);
    } else if (radiance.r < -0.5) {
        colour = vec4(unlit, 1.0);
    } else if (TONE_MAP == 3) {
        colour = vec4(radiance, 1.0);
    } else if (TONE_MAP == 4) {
        vec3 shown = max(radiance, 0.0) + (of_luminance ? more / exposure : vec3(0.0));
        colour = vec4(false_colour(shown, slope), 1.0);
    } else {
        vec3 base = max(radiance, 0.0) * exposure;
        colour = vec4(srgb(tone_mapped(base + more)), 1.0);
#ifdef SHARP
        if (has_looks) {  // samples of other edges are averaged as display colours too
            vec3 sum = vec3(0.0);
            for (int j = 0; j < 4; ++j) sum += 0.25 * srgb(tone_mapped(base + looks[j]));
            colour.rgb = sum;
        }
#endif
    }
}
#endif
