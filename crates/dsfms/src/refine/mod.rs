//! DSfMS: shading and specularities refine the coarse shape (paper §7, eq. 4; in progress).
