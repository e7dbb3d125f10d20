"""The source paper's experiments repeated (Qin et al., section 3), on stages defined by
equations."""
