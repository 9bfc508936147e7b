"""A STEP file of a solid with flat faces, as a program for design would write it: a faceted B-rep of AP 214."""

from __future__ import annotations

import numpy as np

from bracket_ground.interfaces.meshes import Mesh

HEAD = """ISO-10303-21;
HEADER;
FILE_DESCRIPTION((''),'2;1');
FILE_NAME('','',(''),(''),'','','');
FILE_SCHEMA(('AUTOMOTIVE_DESIGN'));
ENDSEC;
DATA;
"""
TAIL = """#11=PRODUCT_CONTEXT('',#10,'mechanical');
#12=PRODUCT('part','part','',(#11));
#13=PRODUCT_DEFINITION_FORMATION('','',#12);
#14=PRODUCT_DEFINITION_CONTEXT('part definition',#10,'design');
#15=PRODUCT_DEFINITION('','',#13,#14);
#16=PRODUCT_DEFINITION_SHAPE('','',#15);
#17=(NAMED_UNIT(*)PLANE_ANGLE_UNIT()SI_UNIT($,.RADIAN.));
#18=(NAMED_UNIT(*)SI_UNIT($,.STERADIAN.)SOLID_ANGLE_UNIT());
#19=(GEOMETRIC_REPRESENTATION_CONTEXT(3)GLOBAL_UNIT_ASSIGNED_CONTEXT((#9,#17,#18))REPRESENTATION_CONTEXT('',''));
#10=APPLICATION_CONTEXT('');
ENDSEC;
END-ISO-10303-21;
"""


def step_file(mesh: Mesh, unit: str = ".MILLI.") -> str:
    """Text of the file.

    Args:
        unit: of the mesh's points: `.MILLI.`, or `$` for metres.
    """
    lines = [f"#9=(LENGTH_UNIT()NAMED_UNIT(*)SI_UNIT({unit},.METRE.));"]

    def add(text: str) -> str:
        lines.append(f"#{len(lines) + 99}={text};")
        return f"#{len(lines) + 98}"

    corners = [add(f"CARTESIAN_POINT('',({','.join(f'{x:.9f}' for x in point)}))") for point in mesh.points_m]
    faces = []
    for triangle, normal in zip(mesh.triangles, mesh.normals, strict=True):
        along = mesh.points_m[triangle[1]] - mesh.points_m[triangle[0]]
        axes = [
            add(f"DIRECTION('',({','.join(f'{x:.9f}' for x in axis)}))")
            for axis in (normal, along / np.linalg.norm(along))
        ]
        plane = add(f"PLANE('',{add(f'AXIS2_PLACEMENT_3D({chr(39) * 2},{corners[triangle[0]]},{axes[0]},{axes[1]})')})")
        loop = add(f"POLY_LOOP('',({','.join(corners[corner] for corner in triangle)}))")
        bound = add(f"FACE_OUTER_BOUND('',{loop},.T.)")
        faces.append(add(f"FACE_SURFACE('',({bound}),{plane},.T.)"))
    shell = add(f"CLOSED_SHELL('',({','.join(faces)}))")
    shape = add(f"FACETED_BREP_SHAPE_REPRESENTATION('',({add(f'FACETED_BREP({chr(39) * 2},{shell})')}),#19)")
    add(f"SHAPE_DEFINITION_REPRESENTATION(#16,{shape})")
    return HEAD + "\n".join(lines) + "\n" + TAIL
