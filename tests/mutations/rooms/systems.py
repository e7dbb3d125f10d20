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
        "no command that looks at an owner runs on Windows",
    ),
    Change(
        "folders-opened-everywhere",
        SYSTEM,
        'if not hasattr(os, "O_DIRECTORY"):',
        "if False:",
        "no result is written on Windows",
    ),
    Change(
        "unix-modules-everywhere",
        SYSTEM,
        "except ImportError:  # Windows\n    resource = None",
        "except ZeroDivisionError:\n    resource = None",
        "nothing starts on Windows",
    ),
    Change(
        "loop-tried-anywhere",
        MAIN,
        "if system.LINUX or {",
        "if True or {",
        "dehyst run ends in a traceback on Windows",
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
        "every user of the machine reads the service's credentials",
        ("tests/packaging/test_debian.py",),
    ),
    Change(
        "image-without-hashes",
        "Containerfile",
        "--require-hashes -r",
        "-r",
        "the image takes files that were not released",
        ("tests/packaging/test_release.py",),
    ),
    Change(
        "placeholder-published",
        "release/publication.py",
        "if RESERVED.search(address):",
        "if address == RESERVED:",
        "a release is published whose address for vulnerabilities belongs to nobody",
        ("tests/packaging/test_release.py",),
    ),
    Change(
        "no-search-in-a-folder",
        "docs/site/iframe-worker.js",
        'location.protocol === "file:"',
        "false",
        "the search of the site finds nothing when it is opened from a folder",
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
