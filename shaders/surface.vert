#version 330 core
// Carries object space to the screen; the light of both sides comes ready with each vertex.

uniform mat4 model;            // object to world
uniform mat4 view_projection;  // world to clip

in vec3 position;
in vec4 front;  // linear radiance [W/m2/sr], weight in its triangles
in vec4 back;   // the same; radiance negative where the face is one-sided

// Centroid: at a silhouette the plain interpolant reaches beyond the triangle and may turn negative.
centroid out vec4 front_radiance;  // times its weight; weight
centroid out vec4 back_radiance;
#ifdef TEXTURED
in vec2 place;  // in the texture
// Not centroid: a pixel's footprint can only be told from its middle to the next one's, and Mesa's centroid lies
// far enough outside small triangles to show other parts of the image.
out vec2 uv;
#endif

void main() {
    front_radiance = vec4(front.rgb * front.a, front.a);
    back_radiance = vec4(back.rgb * back.a, back.a);
#ifdef TEXTURED
    uv = place;
#endif
    gl_Position = view_projection * (model * vec4(position, 1.0));
}
