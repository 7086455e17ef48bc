#version 330 core
// Marks the pixels of one object, for its outline.

out vec4 colour;

void main() {
    colour = vec4(1.0);
}
