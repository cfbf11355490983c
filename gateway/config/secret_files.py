"""As ``gateway.secret_files``, which the relay reads too."""

from gateway.secret_files import CREDENTIAL, CREDENTIALS_FOLDER, refuse_readable_by_others, secret_path

__all__ = ["CREDENTIAL", "CREDENTIALS_FOLDER", "refuse_readable_by_others", "secret_path"]
