"""The source paper's experiments again (Qin et al., section 3), on stages that are equations."""
