"""The equations of Qin et al.: play operator, modified Prandtl-Ishlinskii model, saturation,
monotonicity."""
