/** Create the panel. */
export function create(section, context) {}
