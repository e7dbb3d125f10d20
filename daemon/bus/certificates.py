"""A small certificate authority for one installation: controller and clients, for mutual TLS.

It uses elliptic-curve keys (P-256): one authority, one certificate for the controller (its
addresses in the subject alternative names) and one per client (its name as the common name, by
which the daemon assigns roles). The library does the cryptography; this module sets the contents.
"""

import datetime
import ipaddress
import os
from collections.abc import Sequence
from pathlib import Path

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import ExtendedKeyUsageOID, NameOID

from dehyst.daemon.bus.security import CA, CERTIFICATE, KEY
from dehyst.drivers import system
from dehyst.models.errors import BadInput

_PRIVATE, _PUBLIC = 0o600, 0o644
AUTHORITY_DAYS = 10 * 365  # ten years: outlives the default validity of what it signs, 825 days


def write_new_file(path: Path, data: bytes, mode: int) -> None:
    """Create a file with this mode from the start. Raises BadInput if it exists already."""
    try:
        path.parent.mkdir(parents=True, exist_ok=True, mode=0o700)
        handle = os.open(path, os.O_WRONLY | os.O_CREAT | os.O_EXCL | system.CLOSE_ON_EXEC, mode)
        with open(handle, "wb") as file:
            file.write(data)
    except OSError as error:
        raise BadInput(f"{path}: cannot be written: {error.strerror or error}") from None


class Authority:
    """The installation's own certificate authority; its key stays in `folder`/authority."""

    def __init__(self, folder: Path, days: int) -> None:
        """Load the authority, or create it. Raises BadInput if it cannot be used."""
        self._days = days
        home = folder / "authority"
        if not (home / KEY).exists():
            key = ec.generate_private_key(ec.SECP256R1())
            name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "dehyst authority")])
            builder = _builder(name, name, key.public_key(), AUTHORITY_DAYS)
            constraints = x509.BasicConstraints(ca=True, path_length=0)
            builder = builder.add_extension(constraints, critical=True)
            builder = builder.add_extension(_usage(sign_certificates=True), critical=True)
            certificate = builder.sign(key, hashes.SHA256())
            write_new_file(home / KEY, _key_bytes(key), _PRIVATE)
            write_new_file(home / CA, _certificate_bytes(certificate), _PUBLIC)
        try:
            loaded = serialization.load_pem_private_key((home / KEY).read_bytes(), None)
            self._certificate = x509.load_pem_x509_certificate((home / CA).read_bytes())
        except (OSError, ValueError, TypeError) as error:
            raise BadInput(f"{home}: not an authority that can be used: {error}") from None
        if not isinstance(loaded, ec.EllipticCurvePrivateKey):
            raise BadInput(f"{home / KEY}: not an elliptic-curve key")
        self._key = loaded

    def issue(self, folder: Path, name: str, hosts: Sequence[str] = ()) -> None:
        """Write ca.pem, certificate.pem and key.pem to `folder`. hosts: addresses of a controller;
        empty: a client. Raises BadInput if the folder already holds a key."""
        key = ec.generate_private_key(ec.SECP256R1())
        subject = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, name)])
        builder = _builder(subject, self._certificate.subject, key.public_key(), self._days)
        constraints = x509.BasicConstraints(ca=False, path_length=None)
        builder = builder.add_extension(constraints, critical=True)
        builder = builder.add_extension(_usage(sign_certificates=False), critical=True)
        names: list[x509.GeneralName] = [_host(host) for host in hosts] or [x509.DNSName(name)]
        builder = builder.add_extension(x509.SubjectAlternativeName(names), critical=False)
        use = ExtendedKeyUsageOID.SERVER_AUTH if hosts else ExtendedKeyUsageOID.CLIENT_AUTH
        builder = builder.add_extension(x509.ExtendedKeyUsage([use]), critical=False)
        certificate = builder.sign(self._key, hashes.SHA256())
        write_new_file(folder / KEY, _key_bytes(key), _PRIVATE)
        write_new_file(folder / CERTIFICATE, _certificate_bytes(certificate), _PUBLIC)
        write_new_file(folder / CA, _certificate_bytes(self._certificate), _PUBLIC)


def _builder(
    subject: x509.Name, issuer: x509.Name, key: ec.EllipticCurvePublicKey, days: int
) -> x509.CertificateBuilder:
    now = datetime.datetime.now(datetime.UTC)
    return (
        x509.CertificateBuilder()
        .subject_name(subject)
        .issuer_name(issuer)
        .public_key(key)
        .serial_number(x509.random_serial_number())
        .not_valid_before(now - datetime.timedelta(hours=1))  # clocks differ a little
        .not_valid_after(now + datetime.timedelta(days=days))
    )


def _usage(sign_certificates: bool) -> x509.KeyUsage:
    return x509.KeyUsage(
        digital_signature=True,
        key_cert_sign=sign_certificates,
        crl_sign=sign_certificates,
        content_commitment=False,
        key_encipherment=False,
        data_encipherment=False,
        key_agreement=False,
        encipher_only=False,
        decipher_only=False,
    )


def _host(host: str) -> x509.GeneralName:
    try:
        return x509.IPAddress(ipaddress.ip_address(host))
    except ValueError:
        return x509.DNSName(host)


def _key_bytes(key: ec.EllipticCurvePrivateKey) -> bytes:
    return key.private_bytes(
        serialization.Encoding.PEM,
        serialization.PrivateFormat.PKCS8,
        serialization.NoEncryption(),
    )


def _certificate_bytes(certificate: x509.Certificate) -> bytes:
    return certificate.public_bytes(serialization.Encoding.PEM)
