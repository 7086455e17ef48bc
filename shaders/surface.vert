#version 330 core
// Carries object space to the screen; diffuse light of both sides comes ready with each vertex. Gloss is evaluated here
// for the eye, from the directions of light at the vertex: gi_core/gloss/light.py does the same arithmetic.

uniform mat4 model;            // object to world
uniform mat4 view_projection;  // world to clip

in vec3 position;
in vec3 front;    // linear radiance [W/m2/sr]
in vec3 back;     // the same; negative where the face is one-sided
in vec2 weights;  // of front and back, in triangles

// Centroid: at a silhouette the plain interpolant reaches beyond the triangle and may turn negative.
centroid out vec4 front_radiance;  // times its weight; weight
centroid out vec4 back_radiance;

#if defined(GLOSS) || defined(SHARP)
in vec3 normal;  // of the front
#endif
#ifdef GLOSS
uniform sampler2D owners; // the line of `cells` that each glossy receiver reads
uniform sampler2D cells;  // a line per owner of cells, two texels per cell: shares of irradiance, mean direction
uniform vec2 layout_of;   // lines of a column, cells
uniform vec3 eye;         // in object space
in vec2 glossy;           // glossy receiver of front and back, from 1; 0: none
in vec4 specular;         // F0 red, green, blue; F90
in float alpha;           // < 0: a table, which the processor evaluates; `specular` is its albedo
in vec3 front_lit;        // irradiance [W/m2]
in vec3 back_lit;
centroid out vec3 front_gloss;  // times its weight
centroid out vec3 back_gloss;

in vec3 front_sent;       // radiance of gloss for the eye, where the processor evaluates it
in vec3 back_sent;
uniform bool single_rays;    // kept: the processor evaluates all gloss for the eye, cells serve views in planes
uniform float mirrored_view;  // 1: in a plane, where tables show as diffuse; 2: in a probe, where all gloss does

const float LEAST_ALPHA = 0.15;
const float GRAZING = 0.05;
const float TURNED = -0.2;  // as in radiance.py
const float SPREAD = 0.5;

float smith(float cosine) {
    float tan2 = max(0.0, 1.0 - cosine * cosine) / (cosine * cosine);
    float a = max(alpha, LEAST_ALPHA);
    return 0.5 * (sqrt(1.0 + a * a * tan2) - 1.0);
}

// Radiance of a cell of this share of irradiance, from the direction w of at most unit length.
vec3 sent_from(vec3 share, vec3 w, vec3 n, vec3 to_eye, float at_eye, float far) {
    if (share.r + share.g + share.b <= 0.0) return vec3(0.0);
    float a = max(alpha, LEAST_ALPHA), length_of = max(length(w), 1e-6);
    w /= length_of;
    float wide = a * a + SPREAD * max(1.0 - length_of, 0.0);
    float at_light = max(dot(w, n), GRAZING);
    vec3 h = normalize(w + to_eye);
    float cos_h = dot(h, n), t = cos_h * cos_h * (wide - 1.0) + 1.0;
    float f = wide / (3.14159265 * t * t) / (4.0 * at_light * at_eye * (1.0 + far + smith(at_light)));
    float s = pow(max(0.0, 1.0 - dot(w, h)), 5.0);
    return f * share * (specular.rgb + (specular.a - specular.rgb) * s);
}

vec3 of_cell(ivec2 first, int c, vec3 n, vec3 to_eye, float at_eye, float far) {
    ivec2 at = first + ivec2(2 * c, 0);
    vec3 share = texelFetch(cells, at, 0).rgb;
    return sent_from(share, texelFetch(cells, at + ivec2(1, 0), 0).rgb, n, to_eye, at_eye, far);
}

vec3 gloss(float receiver, vec3 n, vec3 irradiance, vec3 sent) {
    vec3 to_eye = eye - position;
    float at_eye = dot(to_eye, n);
    if (receiver < 0.5) return vec3(0.0);
    if (mirrored_view > 1.5 || (mirrored_view > 0.5 && alpha < 0.0)) {
        return mix(specular.rgb, specular.aaa, 1.0 / 21.0) * irradiance / 3.14159265;  // smooth gloss under even light
    }
    if (alpha < 0.0 || (single_rays && mirrored_view < 0.5)) return sent;
    if (at_eye <= TURNED * length(to_eye)) return vec3(0.0);
    to_eye = normalize(to_eye);
    at_eye = max(dot(to_eye, n), GRAZING);
    float far = smith(at_eye);
    int k = int(receiver) - 1, lines = int(layout_of.x), count = int(layout_of.y);
    int owner = int(texelFetch(owners, ivec2(k / lines, k % lines), 0).r + 0.5);
    ivec2 first = ivec2(2 * count * (owner / lines), owner % lines);
    vec3 sum = vec3(0.0);
    for (int c = 0; c < count; ++c) sum += of_cell(first, c, n, to_eye, at_eye, far);
    return sum * irradiance;
}
#endif
#ifdef SHARP
in vec3 along;  // the tangent
out vec3 point;  // of the world, like the next two
out vec3 shading;
out vec3 grain;
in vec4 lit_a;  // strength of 16 lights without a surface
in vec4 lit_b;
in vec4 lit_c;
in vec4 lit_d;
out vec4 arriving[4];
#endif
#ifdef TEXTURED
in vec2 place;  // in the texture
// Not centroid: a pixel's footprint can only be told from its middle to the next one's, and Mesa's centroid lies
// far enough outside small triangles to show other parts of the image.
out vec2 uv;
#endif

void main() {
    front_radiance = vec4(front * weights.x, weights.x);
    back_radiance = vec4(back * weights.y, weights.y);
#ifdef SHARP
    point = (model * vec4(position, 1.0)).xyz;
    shading = mat3(model) * normal;
    grain = mat3(model) * along;
    arriving[0] = lit_a;
    arriving[1] = lit_b;
    arriving[2] = lit_c;
    arriving[3] = lit_d;
#endif
#ifdef GLOSS
    front_gloss = weights.x * gloss(glossy.x, normal, front_lit, front_sent);
    back_gloss = weights.y * gloss(glossy.y, -normal, back_lit, back_sent);
#endif
#ifdef TEXTURED
    uv = place;
#endif
    gl_Position = view_projection * (model * vec4(position, 1.0));
}
