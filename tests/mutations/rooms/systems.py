"""Other operating systems, releases: what runs where, and what a package holds."""

from tests.mutations.change import Change, room

SYSTEM, MAIN = "drivers/system.py", "daemon/main.py"

CHANGES = room(
    ("tests/packaging/test_systems.py",),
    Change(
        "users-have-numbers-everywhere",
        SYSTEM,
        "return os.geteuid() if MODES else 0",
        "return os.geteuid()",
        "no command that checks a file's owner runs on Windows",
    ),
    Change(
        "folders-opened-everywhere",
        SYSTEM,
        'if not hasattr(os, "O_DIRECTORY"):',
        "if False:",
        "no result can be written on Windows",
    ),
    Change(
        "unix-modules-everywhere",
        SYSTEM,
        "except ImportError:  # Windows\n    resource = None",
        "except ZeroDivisionError:\n    resource = None",
        "no program starts on Windows",
    ),
    Change(
        "loop-tried-anywhere",
        MAIN,
        "if system.LINUX or {",
        "if True or {",
        "dehyst run causes a traceback on Windows",
    ),
    Change(
        "package-names-its-workshop",
        "release/debian.py",
        "replace(here, OPT)",
        "replace(here, here)",
        "no command of the Debian package starts",
        ("tests/packaging/test_debian.py",),
    ),
    Change(
        "configuration-for-everybody",
        "release/debian/postinst",
        "chmod 0750",
        "chmod 0755",
        "every user of the machine can read the service's credentials",
        ("tests/packaging/test_debian.py",),
    ),
    Change(
        "image-without-hashes",
        "Containerfile",
        "--require-hashes -r",
        "-r",
        "the image installs files that were not released",
        ("tests/packaging/test_release.py",),
    ),
    Change(
        "placeholder-published",
        "release/publication.py",
        "if RESERVED.search(address):",
        "if address == RESERVED:",
        "a release is published with a placeholder as its address for vulnerabilities",
        ("tests/packaging/test_release.py",),
    ),
    Change(
        "no-search-in-a-folder",
        "docs/site/iframe-worker.js",
        'location.protocol === "file:"',
        "false",
        "the site's search finds nothing when the site is opened from a folder",
        ("tests/packaging/test_site.py",),
    ),
    Change(
        "posix-name-elsewhere",
        "daemon/files/appended.py",
        "system.CLOSE_ON_EXEC",
        "os.O_CLOEXEC",
        "dehyst record does not start on Windows",
    ),
)
