#version 330 core
// Carries object space to the screen; the light of both sides comes ready with each vertex.

uniform mat4 model;            // object to world
uniform mat4 view_projection;  // world to clip

in vec3 position;
in vec3 front;  // linear radiance [W/m2/sr]
in vec3 back;   // the same; negative where the face is one-sided

// Centroid: at a silhouette the plain interpolant reaches beyond the triangle and may turn negative.
centroid out vec3 front_radiance;
centroid out vec3 back_radiance;
#ifdef TEXTURED
in vec2 place;  // in the texture
// Not centroid: a pixel's footprint can only be told from its middle to the next one's, and Mesa's centroid lies
// far enough outside small triangles to show other parts of the image.
out vec2 uv;
#endif

void main() {
    front_radiance = front;
    back_radiance = back;
#ifdef TEXTURED
    uv = place;
#endif
    gl_Position = view_projection * (model * vec4(position, 1.0));
}
