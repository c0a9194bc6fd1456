// Provides no colour: OpenGL writes the depth of a shadow map without a fragment shader.
// Twin: none, there is no colour.
void main()
{
}
