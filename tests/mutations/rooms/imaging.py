"""The virtual microscope: what a picture may hide, and what counts as distortion."""

from tests.mutations.change import Change, room

MICROSCOPE, EXPERIMENT = "daemon/imaging/microscope.py", "daemon/imaging/experiment.py"
PLACES = ("tests/daemon/imaging/test_microscope.py",)
PICTURES = ("tests/daemon/imaging/test_image.py",)

CHANGES = [
    *room(
        PLACES,
        Change(
            "seam-of-the-trace-with-itself",
            MICROSCOPE,
            "np.mean(lines[1::2], axis=0)",
            "np.mean(lines[0::2], axis=0)",
            "a picture that is torn between trace and retrace is reported without a seam",
        ),
        Change(
            "distortion-without-y",
            MICROSCOPE,
            "for true, wanted in ((self.true_x, self.scan.x), (self.true_y, self.scan.y))",
            "for true, wanted in ((self.true_x, self.scan.x),)",
            "errors of the slow axis are not counted",
        ),
    ),
    *room(
        PICTURES,
        Change(
            "learned-picture-without-its-correction",
            EXPERIMENT,
            "followed = run.follow({axis: targets[axis] + used[axis] for axis in targets})",
            "followed = run.follow(targets)",
            "the learned correction is not sent, but the picture is labelled as learned",
        ),
    ),
]
