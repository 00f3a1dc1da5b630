"""The paper's Fig. 5 in small: error in the deformed zone against extension."""

import dsfms

METHODS: tuple[dsfms.Method, ...] = ("dsfm", "dsfms", "joint")

for extension in (0.0, 10.0, 20.0):
    case = dsfms.synthesize(extension=extension, vertices=150, noise=1.0)
    line = f"{extension:4.0f} %"
    for method in METHODS:
        surface = dsfms.reconstruct(
            case.template, case.image, case.camera, method=method, matches=case.matches
        )
        found = dsfms.evaluate(surface, case.truth, visible=case.visible, zone=case.zone)
        stats = found.visible_zone or found.visible
        if stats is not None:
            line += f"  {method} {stats.rms:.2f} mm"
    print(line)
