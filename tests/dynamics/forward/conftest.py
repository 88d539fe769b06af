from study.export.conftest import headers

__all__ = ["headers"]
