"""Runs all validators of OpenUSD on packages; prints what they say, and exits with 1 where that is anything.

    pip install usd-core
    python3 validate_usdz.py MESH.usdz...
"""

import sys

from pxr import Usd, UsdValidation

failed = False
for path in sys.argv[1:]:
    validators = UsdValidation.ValidationRegistry().GetOrLoadAllValidators()
    messages = UsdValidation.ValidationContext(validators).Validate(Usd.Stage.Open(path))
    for message in messages:
        print(f"FAILED {path}: {message.GetName()}: {message.GetMessage()}")
    if not messages:
        version = ".".join(str(part) for part in Usd.GetVersion()[1:])
        print(f"ok OpenUSD {version}: {len(validators)} validators have no message on {path}")
    failed |= bool(messages)
sys.exit(failed)
