"""How a shape is written: arcs, kinematics, basis series."""
