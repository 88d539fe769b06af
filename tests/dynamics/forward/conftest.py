from exporting.conftest import headers

__all__ = ["headers"]
