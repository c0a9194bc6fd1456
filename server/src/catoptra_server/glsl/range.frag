// Provides the range of a surface from the viewpoint.
// Twin: catoptra_server.render.trace.trace_engine.RayHits.
in vec3 offset;
out float range_m;

void main()
{
    range_m = length(offset);
}
