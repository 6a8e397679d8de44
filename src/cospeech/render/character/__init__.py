"""The character that films and pages show: a body of meshes, a head with its face, and the triangles they end in."""
