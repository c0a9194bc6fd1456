// Provides the polygon around the rim circle, outside of which no fragment need be asked.
// Twin: catoptra_server.render.raster.mirror_pass.polygon_around_rim.
in vec2 position;

void main()
{
    gl_Position = vec4(position, 0.0, 1.0);
}
