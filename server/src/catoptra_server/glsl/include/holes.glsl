// Provides bool is_passed(): whether the camera sees through the facet at this fragment.
// Twin: catoptra_server.render.trace.reference.meshes, passes_facet in bvh.c.
in vec2 facet_filter;                // opacity over that of the emptiest surface; 1: no back

bool is_passed()
{
    if (facet_filter.y > 0.5 && dot(facet_normal, offset) > 0.0)
        return true;
    float opacity = facet_filter.x;
#ifdef TEXTURED
    opacity *= textureLod(albedo_texture, texture_coordinates, 0.0).a;
#endif
    return opacity < 1.0;
}
