#version 330 core
// Carries a pane of glass to the screen.

uniform mat4 model;            // object to world
uniform mat4 view_projection;  // world to clip

in vec3 position;
in vec3 front;  // radiance of a white surface: the mean of the light that meets the pane
in vec3 back;
out vec3 point;  // of the world
out vec3 front_light;
out vec3 back_light;

void main() {
    point = (model * vec4(position, 1.0)).xyz;
    front_light = front;
    back_light = back;
    gl_Position = view_projection * vec4(point, 1.0);
}
