"""The paper's equations: play operator, modified Prandtl-Ishlinskii model, saturation,
monotonicity."""
