// Provides the range of a surface from the viewpoint.
// Twin: catoptra_server.render.trace.pixel_ranges.PixelRanges.of.
in vec3 place;
out float range_m;

void main()
{
    range_m = length(place);
}
