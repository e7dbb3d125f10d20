"""Messages, keys, and who may connect."""

from tests.mutations.change import Change, room

ENCODING, MESSAGES = "daemon/bus/encoding.py", "daemon/bus/messages.py"
SECURITY, KEYS = "daemon/bus/security.py", "daemon/bus/keys.py"
MESSAGE_TESTS = ("tests/daemon/bus/test_encoding.py",)
ROUTED = "tests/daemon/bus/test_router.py::test_no_way_through_a_router_without_credentials"
SECURITY_TESTS = ("tests/daemon/bus/test_security.py", "tests/daemon/bus/test_keys.py")


CHANGES = [
    *room(
        ("tests/daemon/test_prepared.py",),
        Change(
            "first-reader-works-it-out",
            "daemon/prepared.py",
            "        msgspec.msgpack.Decoder(kind)\n",
            "        pass\n",
            "two threads that read a configuration at once crash the process",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_starved.py",),
        Change(
            "each-event-a-batch",
            "daemon/bus/topics.py",
            'EVENT = Topic("event", full="drop", priority="DATA_HIGH", express=False)',
            'EVENT = Topic("event", full="drop", priority="DATA_HIGH", express=True)',
            "a burst of events fills the link of a subscriber that reads, and its end is lost",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_session.py",),
        Change(
            "callbacks-outlive-their-session",
            "daemon/bus/session.py",
            "in wait(self._callback_threads, CALLBACK_ENDS_S).done:",
            "in wait(self._callback_threads, 0.0).done:",
            "a program whose client lived in a daemon thread aborts at its end",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_contract.py",),
        Change(
            "strict-readers",
            "daemon/bus/messages.py",
            "class Message(msgspec.Struct, frozen=True, kw_only=True):",
            "class Message(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):",
            "an added field breaks every older client",
        ),
        Change(
            "version-stands-still",
            "daemon/bus/messages.py",
            "    version: Version = 2\n    gateway: GatewayStatus\n",
            "    gateway: GatewayStatus\n",
            "a reader cannot see that fields were added",
        ),
    ),
    *room(
        ("tests/daemon/bus/test_versions.py",),
        Change(
            "silent-to-older-clients",
            "daemon/gateway/process.py",
            "                    bus.answer(questions, refuse_older_clients)\n",
            "",
            "a client of an older version waits without any answer",
        ),
    ),
    *room(
        MESSAGE_TESTS,
        Change(
            "loose-types",
            ENCODING,
            "kind, strict=True,",
            "kind, strict=False,",
            "a string is driven as a number",
        ),
        Change(
            "any-length",
            ENCODING,
            "if len(payload) > limit:",
            "if False:",
            "ten megabytes are decoded in the gateway",
        ),
        Change(
            "odd-chunk",
            ENCODING,
            "size % 8 or not size",
            "not size",
            "a truncated number in a chunk causes an error in the daemon",
        ),
        Change(
            "chunk-lengths-differ",
            ENCODING,
            "if size != len(chunk.offset_ns) or size",
            "if size",
            "a chunk with fewer times than targets reaches the gate",
        ),
        Change(
            "empty-chunk",
            ENCODING,
            " or not size:",
            ":",
            "an empty chunk reaches the gate",
        ),
        Change(
            "chunk-not-checked",
            ENCODING,
            "        points(command)\n",
            "        pass\n",
            "a chunk whose columns differ is decoded as good",
            survives="the gate takes a chunk apart with `points` itself, and refuses it there",
        ),
        Change(
            "telemetry-column-short",
            ENCODING,
            "if len(column) != message.count * dtype.itemsize:",
            "if False:",
            "telemetry with a short column is shown shifted",
        ),
        Change(
            "telemetry-numbering",
            ENCODING,
            "np.arange(message.first_seq, message.first_seq +",
            "np.arange(message.first_seq + 1, message.first_seq + 1 +",
            "samples carry their neighbour's number",
        ),
        Change(
            "most-points",
            MESSAGES,
            "MAX_POINTS = 16_384",
            "MAX_POINTS = 16_384_000",
            "a chunk of any size holds up the gateway",
        ),
    ),
    *room(
        SECURITY_TESTS,
        Change(
            "open-to-the-network",
            SECURITY,
            "if not authenticated and not is_loopback(endpoint):",
            "if False:",
            "anybody on the network can move the stage",
        ),
        Change(
            "all-is-loopback",
            SECURITY,
            "    except ValueError:\n        return False",
            "    except ValueError:\n        return True",
            "a host name on the network counts as this machine",
        ),
        Change(
            "router-without-credentials",
            SECURITY,
            "if not credentials and not is_loopback(endpoint):",
            "if False:",
            "anybody at the router can move the stage",
            tests=(ROUTED,),
        ),
        Change(
            "listens-behind-router",
            SECURITY,
            "if credentials and listen:",
            "if False:",
            "the router can be bypassed",
            tests=(ROUTED,),
        ),
        Change(
            "roles-behind-router",
            SECURITY,
            "if roles and connect:",
            "if False:",
            "roles are configured in a set-up that cannot enforce them",
            tests=(ROUTED,),
        ),
        Change(
            "allow-by-default",
            SECURITY,
            '"default_permission": "deny"',
            '"default_permission": "allow"',
            "observers can command the stage",
        ),
        Change(
            "observers-operate",
            SECURITY,
            '"subjects": ["operators"]})',
            '"subjects": list(roles)})',
            "observers can command the stage",
        ),
        Change(
            "access-off",
            SECURITY,
            '"enabled": True,',
            '"enabled": False,',
            "configured roles are not enforced",
        ),
        Change(
            "world-readable-key",
            SECURITY,
            "if private and system.others_may(found, stat.S_IRWXO | stat.S_IWGRP):",
            "if False:",
            "a private key that everybody can read is used",
        ),
        Change(
            "no-mutual-tls",
            SECURITY,
            '/enable_mtls": True',
            '/enable_mtls": False',
            "clients without a certificate can connect",
        ),
        Change(
            "short-password",
            SECURITY,
            "len(password) >= 8",
            "len(password) >= 1",
            "a password of one letter is accepted",
        ),
        Change(
            "missing-password",
            SECURITY,
            "        if missing:\n",
            "        if False:\n",
            "a person is configured without a password and cannot connect",
        ),
        Change(
            "plain-with-certificates",
            SECURITY,
            "        if plain:\n",
            "        if False:\n",
            "certificates are configured but the line is not encrypted",
        ),
        Change(
            "name-twice",
            SECURITY,
            "if len(set(people)) < len(people):",
            "if False:",
            "an observer who is also named as operator can command",
        ),
        Change(
            "nobody-named",
            SECURITY,
            "    if not people:\n",
            "    if False:\n",
            "a daemon to which nobody can connect starts without a message",
        ),
        Change(
            "wild-name",
            KEYS,
            "[a-z0-9_-]{1,63}",
            "[a-z0-9_*-]{1,63}",
            "a controller called * answers for all controllers",
        ),
        Change(
            "client-as-authority",
            "daemon/bus/certificates.py",
            "x509.BasicConstraints(ca=False, path_length=None)",
            "x509.BasicConstraints(ca=True, path_length=None)",
            "a client can sign certificates itself",
        ),
        Change(
            "key-for-everybody",
            "daemon/bus/certificates.py",
            "_PRIVATE, _PUBLIC = 0o600, 0o644",
            "_PRIVATE, _PUBLIC = 0o644, 0o644",
            "private keys can be read by everybody",
        ),
    ),
    *room(
        MESSAGE_TESTS,
        Change(
            "refused-without-a-reason",
            "daemon/bus/encoding.py",
            "why = str(error) or _SILENT.get(type(error), type(error).__name__)",
            "why = str(error)",
            "bytes that are not msgpack are refused with an empty reason",
        ),
    ),
    *room(
        (
            "tests/daemon/bus/test_hostile.py::test_a_command_that_is_too_long_is_answered_with_the_limit",
            "tests/daemon/bus/test_hostile.py::test_few_commands_that_are_too_long_wait",
        ),
        Change(
            "too-long-for-an-answer",
            "daemon/bus/session.py",
            "_common(MAX_ANSWERED_BYTES + 4096)",
            "_common(MAX_COMMAND_BYTES + 4096)",
            "a command that is too long gets no answer",
        ),
        Change(
            "long-ones-fill-the-memory",
            "daemon/bus/session.py",
            "if len(self.payload) <= MAX_COMMAND_BYTES else MOST_LONG)",
            ")",
            "commands that are too long fill 2 GiB of the gateway's memory",
        ),
    ),
]
