"""`dfcgs encode` with what only Python takes: `python -m evaluation.tuned FRAMES TARGET OPTIONS`.

OPTIONS is JSON: fields of EncoderOptions by name, `tuning` an object with those of EncoderTuning. Prints what
the expected PSNR is, as `dfcgs encode --json` does.
"""

from __future__ import annotations

import json
import os
import sys


def main(frames: str, target: str, options: str) -> None:
    """Encode with all cores; numpy's BLAS has one thread, as on the command line."""
    for name in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        os.environ.setdefault(name, "1")
    from dfcgs_codec import EncoderOptions, EncoderTuning, encode_sequence

    fields = json.loads(options)
    tuning = EncoderTuning(**fields.pop("tuning", {}))
    report = encode_sequence(frames, target, EncoderOptions(**fields, tuning=tuning, jobs=None))
    print(json.dumps({"estimated_psnr": report.estimated_psnr}))


if __name__ == "__main__":
    main(*sys.argv[1:])
