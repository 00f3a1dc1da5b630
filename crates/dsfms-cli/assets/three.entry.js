export { WebGLRenderer, Scene, PerspectiveCamera, Mesh, BufferGeometry, BufferAttribute, RawShaderMaterial, LineSegments, Points, Texture, Raycaster, Group, Vector2, Vector3, Color, SphereGeometry, DoubleSide } from 'three';
export { OrbitControls } from 'three/examples/jsm/controls/OrbitControls.js';
