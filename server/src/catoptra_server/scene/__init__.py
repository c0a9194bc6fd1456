"""What is in the world: descriptions, and the triangles made of them. Knows no renderer."""
