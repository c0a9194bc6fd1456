// Provides bool is_passed(): whether the camera sees through the facet at this fragment.
// Twin: catoptra_server.render.trace.reference.meshes, find_coverage in bvh.c.
in vec2 facet_filter;                // opacity over that of the emptiest surface; 1: no back, plus
                                     // 2: it blends

float find_coverage()
{
    if (fract(0.5 * facet_filter.y + 0.125) > 0.5 && dot(facet_normal, offset) > 0.0)
        return -1.0;
    float opacity = facet_filter.x;
#ifdef TEXTURED
    opacity *= textureLod(albedo_texture, texture_coordinates, 0.0).a;
#endif
    return opacity;
}

bool is_passed()
{
    const float WHOLE = 0.99999;     // of a coverage of 1 at all corners, interpolation may lose
#ifdef LEAST_LAYER                   // 1 over the least coverage of a layer
    return facet_filter.y < 1.5 || find_coverage() < 1.0 / float(LEAST_LAYER);
#elif defined(OPAQUE)
    return facet_filter.y > 1.5 || find_coverage() < WHOLE;
#else
    return find_coverage() < WHOLE;
#endif
}
