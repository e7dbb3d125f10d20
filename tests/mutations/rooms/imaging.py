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
            "a picture that is torn between trace and retrace has no seam",
        ),
        Change(
            "distortion-without-y",
            MICROSCOPE,
            "for true, wanted in ((self.true_x, self.scan.x), (self.true_y, self.scan.y))",
            "for true, wanted in ((self.true_x, self.scan.x),)",
            "what the slow axis does wrong is not counted",
        ),
    ),
    *room(
        PICTURES,
        Change(
            "learned-picture-without-its-correction",
            EXPERIMENT,
            "followed = run.follow({axis: targets[axis] + used[axis] for axis in targets})",
            "followed = run.follow(targets)",
            "what was learned is not sent to the stage, and the picture calls itself learned",
        ),
    ),
]
