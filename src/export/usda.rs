//! USD text: a UsdPhysics articulation with textured meshes.
//!
//! It is one layer: rigid bodies as siblings, joints between them, convex colliders, mass, preview materials.
//! USD angles are in degrees; joint axes are X, so joint frames are rotated.

use std::fmt::Write as _;

use nalgebra::{Matrix3, Rotation3, SymmetricEigen, UnitQuaternion, Vector3};

use super::{
    config::Base,
    drawn::{Drawn, Visual},
    mjcf::quaternion,
    number::{decimal, significant},
    urdf::{grasp_name, solid_name},
};
use geometry::Pose;
use model::{ArticulatedModel, Inertial, Joint, identifier};
use surface::TriangleMesh;

/// USD text of a model; `drawn` are its meshes. The root is fixed to the world, or floats.
pub fn usda(model: &ArticulatedModel, drawn: &[Drawn], base: Base) -> String {
    let name = &*identifier(&model.name);
    // Units and up axis are stated, as USD's defaults are centimeters and y.
    let mut text = format!(
        "#usda 1.0\n(\n    defaultPrim = \"{name}\"\n    metersPerUnit = 1\n    kilogramsPerUnit = \
         1\n    upAxis = \"Z\"\n)\n\n\
         def Xform \"{name}\" (\n    prepend apiSchemas = [\"PhysicsArticulationRootAPI\"]\n    kind \
         = \"component\"\n)\n{{\n"
    );
    text.push_str("    def Scope \"Looks\"\n    {\n");
    for visual in drawn.iter().map(|d| &d.visual) {
        push_material(&mut text, name, visual);
    }
    text.push_str(PHYSICS_MATERIAL);
    text.push_str("    }\n");
    let closed = vec![0.0; model.joints.len()];
    // Bodies are siblings, each placed in the model: a prim below a rigid body would be part of that body.
    for (i, link) in model.links.iter().enumerate() {
        let pose = model.world_from_link(i, &closed);
        // Writing to a string cannot fail, here and below.
        writeln!(
            text,
            "\n    def Xform \"{}\" (\n        prepend apiSchemas = \
             [\"PhysicsRigidBodyAPI\", \"PhysicsMassAPI\"]\n    )\n    {{",
            identifier(&link.name)
        )
        .ok();
        push_place(&mut text, &pose, "        ");
        push_mass(&mut text, &link.inertial);
        for own in drawn.iter().filter(|d| d.link == i) {
            push_visual(&mut text, name, own);
        }
        for (k, solid) in link.collision.iter().enumerate() {
            push_collider(&mut text, name, &solid_name(link, k), &solid.to_mesh());
        }
        for (k, grasp) in link.grasps.iter().enumerate() {
            let name = grasp_name(link, k);
            writeln!(text, "        def Xform \"{}\"\n        {{", identifier(&name)).ok();
            push_place(&mut text, &grasp.link_from_grasp, "            ");
            text.push_str("        }\n");
        }
        text.push_str("    }\n");
    }
    text.push_str("\n    def Scope \"Joints\"\n    {\n");
    // A joint without a first body ties the other body to the world.
    if let Some(root) = model.links.first().filter(|_| base == Base::Fixed) {
        writeln!(
            text,
            "        def PhysicsFixedJoint \"world_fixed\"\n        {{\n            rel physics:body1 = \
             </{name}/{}>\n        }}",
            identifier(&root.name)
        )
        .ok();
    }
    for joint in &model.joints {
        push_joint(&mut text, model, joint);
    }
    text.push_str("    }\n}\n");
    text
}

/// Adds the pose of a prim in its parent.
fn push_place(text: &mut String, pose: &Pose, pad: &str) {
    let translate = tuple(&pose.translation.vector);
    let orient = turn(&pose.rotation);
    writeln!(text, "{pad}double3 xformOp:translate = {translate}").ok();
    writeln!(text, "{pad}quatf xformOp:orient = {orient}").ok();
    writeln!(text, "{pad}uniform token[] xformOpOrder = [\"xformOp:translate\", \"xformOp:orient\"]").ok();
}

/// Friction between surfaces: assumed, as of wood on wood.
const PHYSICS_MATERIAL: &str = "        def Material \"Contact\" (\n            prepend apiSchemas = \
    [\"PhysicsMaterialAPI\"]\n        )\n        {\n            \
     float physics:staticFriction = 0.6\n            float physics:dynamicFriction = \
     0.5\n            float physics:restitution = 0\n        }\n";

fn push_material(text: &mut String, model: &str, visual: &Visual) {
    let name = identifier(&visual.material);
    let file = visual.texture_path();
    let path = format!("/{model}/Looks/{name}");
    write!(
        text,
        r#"        def Material "{name}"
        {{
            token outputs:surface.connect = <{path}/Surface.outputs:surface>
            def Shader "Surface"
            {{
                uniform token info:id = "UsdPreviewSurface"
                color3f inputs:diffuseColor.connect = <{path}/Texture.outputs:rgb>
                float inputs:metallic = 0
                float inputs:roughness = 0.8
                token outputs:surface
            }}
            def Shader "Texture"
            {{
                uniform token info:id = "UsdUVTexture"
                asset inputs:file = @./{file}@
                float2 inputs:st.connect = <{path}/Coordinates.outputs:result>
                token inputs:sourceColorSpace = "sRGB"
                token inputs:wrapS = "clamp"
                token inputs:wrapT = "clamp"
                float3 outputs:rgb
            }}
            def Shader "Coordinates"
            {{
                uniform token info:id = "UsdPrimvarReader_float2"
                string inputs:varname = "st"
                float2 outputs:result
            }}
        }}
"#
    )
    .ok();
}

fn push_mass(text: &mut String, inertial: &Inertial) {
    let (moments, axes) = principal(&inertial.inertia);
    writeln!(text, "        float physics:mass = {}", short(inertial.mass_kg)).ok();
    writeln!(text, "        point3f physics:centerOfMass = {}", tuple(&inertial.center_of_mass.coords)).ok();
    writeln!(text, "        float3 physics:diagonalInertia = ({})", moments.map(short).join(", ")).ok();
    writeln!(text, "        quatf physics:principalAxes = {}", turn(&axes)).ok();
}

/// Principal moments and the rotation of their axes.
fn principal(inertia: &Matrix3<f64>) -> ([f64; 3], UnitQuaternion<f64>) {
    // docs/method.md 11.2. Eigenvectors may form a reflection, which has no quaternion.
    let eigen = SymmetricEigen::new(*inertia);
    let mut axes = eigen.eigenvectors;
    if axes.determinant() < 0.0 {
        axes.column_mut(2).neg_mut();
    }
    (eigen.eigenvalues.into(), UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix_unchecked(axes)))
}

fn push_visual(text: &mut String, model: &str, Drawn { visual, look, .. }: &Drawn) {
    let material = identifier(&visual.material);
    open_mesh(text, &visual.name, "\"MaterialBindingAPI\"");
    push_points(text, &look.mesh);
    // One value per face corner: a vertex on a seam has texture coordinates in each of its charts.
    let corner = |i: &u32| &look.corners[*i as usize];
    let all: Vec<_> = look.triangles.iter().flatten().map(corner).collect();
    let normals = all
        .iter()
        .map(|c| format!("({})", [c.normal.x, c.normal.y, c.normal.z].map(|x| decimal(x, 4)).join(", ")));
    push_list(
        text,
        "normal3f[] normals",
        normals,
        " (\n                interpolation = \"faceVarying\"\n            )",
    );
    let uv = all.iter().map(|c| format!("({})", c.uv.map(|x| decimal(x, 6)).join(", ")));
    push_list(
        text,
        "texCoord2f[] primvars:st",
        uv,
        " (\n                interpolation = \"faceVarying\"\n            )",
    );
    // A seen surface is open, so it is also drawn from behind.
    text.push_str("            uniform bool doubleSided = 1\n");
    writeln!(text, "            rel material:binding = </{model}/Looks/{material}>\n        }}").ok();
}

fn normal_text(mesh: &TriangleMesh, triangle: usize) -> String {
    let [a, b, c] = mesh.corners(triangle).map(|p| p.cast::<f64>());
    let n = (b - a).cross(&(c - a)).try_normalize(0.0).unwrap_or_else(Vector3::z);
    format!("({})", [n.x, n.y, n.z].map(|x| decimal(x, 4)).join(", "))
}

fn push_collider(text: &mut String, model: &str, name: &str, mesh: &TriangleMesh) {
    open_mesh(text, name, "\"PhysicsCollisionAPI\", \"PhysicsMeshCollisionAPI\", \"MaterialBindingAPI\"");
    push_points(text, mesh);
    // NVIDIA's asset validator also requires normals of colliders.
    let normals = (0..mesh.triangles.len()).map(|t| normal_text(mesh, t));
    push_list(
        text,
        "normal3f[] normals",
        normals,
        " (\n                interpolation = \"uniform\"\n            )",
    );
    text.push_str(
        // PhysX does not collide triangle meshes of moving bodies. A guide is not displayed over the visual
        // mesh.
        "            uniform token physics:approximation = \"convexHull\"\n            uniform \
        token purpose = \"guide\"\n",
    );
    writeln!(text, "            rel material:binding:physics = </{model}/Looks/Contact>\n        }}").ok();
}

fn open_mesh(text: &mut String, name: &str, schemas: &str) {
    let name = identifier(name);
    writeln!(
        text,
        "        def Mesh \"{name}\" (\n            prepend apiSchemas = [{schemas}]\n        )\n        {{"
    )
    .ok();
    text.push_str(
        // USD subdivides a mesh by default and would round off its edges.
        "            uniform token subdivisionScheme = \"none\"\n            uniform token \
        orientation = \"rightHanded\"\n",
    );
}

fn push_points(text: &mut String, mesh: &TriangleMesh) {
    let point = |p: &nalgebra::Point3<f32>| tuple(&p.coords.cast());
    if let Some((lo, hi)) = mesh.bounds() {
        writeln!(text, "            float3[] extent = [{}, {}]", point(&lo), point(&hi)).ok();
    }
    push_list(text, "int[] faceVertexCounts", mesh.triangles.iter().map(|_| "3".to_owned()), "");
    push_list(text, "int[] faceVertexIndices", mesh.triangles.iter().flatten().map(u32::to_string), "");
    push_list(text, "point3f[] points", mesh.vertices.iter().map(point), "");
}

fn push_list(text: &mut String, name: &str, items: impl Iterator<Item = String>, after: &str) {
    writeln!(text, "            {name} = [{}]{after}", items.collect::<Vec<_>>().join(", ")).ok();
}

fn push_joint(text: &mut String, model: &ArticulatedModel, joint: &Joint) {
    let name = identifier(&model.name);
    // USD has no screw: the nearest joint is written, with its pitch as an extra attribute.
    let (kind, drive) = if joint.kind.turns() { ("Revolute", "angular") } else { ("Prismatic", "linear") };
    let pitch = joint
        .kind
        .pitch_m_per_rad()
        .map(|p| format!("\n            custom double artitwin:pitchPerRadian = {}", short(p)));
    let pitch = pitch.unwrap_or_default();
    // Per degree where USD uses degrees; efforts are the same.
    let per_rad = if joint.kind.turns() { 1f64.to_radians() } else { 1.0 };
    // Opposite directions have no shortest turn between them; half a turn about y also takes x to -x.
    let axis = UnitQuaternion::rotation_between(&Vector3::x(), &joint.axis)
        .unwrap_or_else(|| UnitQuaternion::from_axis_angle(&Vector3::y_axis(), std::f64::consts::PI));
    // The drive acts as the spring. Damping is written for PhysX and Newton instead, so it acts only
    // once. Friction is PhysX's effort in N m; the older `physxJoint:jointFriction` is a coefficient without
    // a unit.
    let l = &joint.limit;
    let d = &joint.dynamics;
    let [body0, body1] = [joint.parent, joint.child].map(|k| identifier(&model.links[k].name));
    write!(
        text,
        r#"        def Physics{kind}Joint "{joint}" (
            prepend apiSchemas = ["PhysicsDriveAPI:{drive}", "PhysxJointAxisAPI:{drive}", "NewtonJointAPI"]
        )
        {{
            uniform token physics:axis = "X"{pitch}
            rel physics:body0 = </{name}/{body0}>
            rel physics:body1 = </{name}/{body1}>
            point3f physics:localPos0 = {place}
            point3f physics:localPos1 = (0, 0, 0)
            quatf physics:localRot0 = {turn0}
            quatf physics:localRot1 = {turn1}
            bool physics:collisionEnabled = false
            float physics:lowerLimit = {lower}
            float physics:upperLimit = {upper}
            uniform token drive:{drive}:physics:type = "force"
            float drive:{drive}:physics:stiffness = {stiffness}
            float drive:{drive}:physics:targetPosition = {target}
            float drive:{drive}:physics:damping = 0
            float physxJointAxis:{drive}:staticFrictionEffort = {friction}
            float physxJointAxis:{drive}:dynamicFrictionEffort = {friction}
            float physxJointAxis:{drive}:viscousFrictionCoefficient = {damping}
            float newton:friction = {friction}
            float newton:damping = {damping}
            float newton:armature = {armature}
        }}
"#,
        joint = identifier(&joint.name),
        place = tuple(&joint.parent_from_joint.translation.vector),
        turn0 = turn(&(joint.parent_from_joint.rotation * axis)),
        turn1 = turn(&axis),
        lower = short(l.lower / per_rad),
        upper = short(l.upper / per_rad),
        stiffness = short(d.stiffness * per_rad),
        target = short(d.spring_reference / per_rad),
        friction = short(d.friction),
        damping = short(d.damping * per_rad),
        armature = short(d.armature),
    )
    .ok();
}

fn tuple(v: &Vector3<f64>) -> String {
    format!("({}, {}, {})", decimal(v.x, 7), decimal(v.y, 7), decimal(v.z, 7))
}

fn turn(rotation: &UnitQuaternion<f64>) -> String {
    format!("({})", quaternion(rotation).map(|x| decimal(x, 9)).join(", "))
}

fn short(x: f64) -> String {
    significant(x, 9)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::drawn::{drawn_meshes, plain_looks};
    use model::example::cabinet;

    fn text(model: &ArticulatedModel) -> String {
        usda(model, &drawn_meshes(model, &plain_looks(model)), Base::Fixed)
    }

    #[test]
    fn angles_are_degrees_and_lengths_are_not() {
        let mut model = cabinet();
        model.joints[0].dynamics.damping = 1.8;
        model.joints[0].dynamics.friction = 0.3;
        let text = text(&model);
        assert!(text.contains("upperLimit = 71.6197244") && text.contains("upperLimit = 0.18\n"), "{text}");
        assert!(text.contains("newton:damping = 0.0314159265") && text.contains("newton:friction = 0.3\n"));
        let count = |what: &str| text.matches(what).count();
        assert_eq!(
            [
                count("PhysicsRigidBodyAPI"),
                count("PhysicsCollisionAPI"),
                count("UsdUVTexture"),
                count("Joint \"")
            ],
            [3, 3, 3, 3]
        );
        assert_eq!(count("{"), count("}"));
        let looks = plain_looks(&model);
        assert!(!usda(&model, &drawn_meshes(&model, &looks), Base::Floating).contains("PhysicsFixedJoint"));
        assert!(text.contains("PhysicsFixedJoint"));
    }

    #[test]
    fn principal_axes_give_the_tensor_back() {
        let tensor = Matrix3::new(2.0, 0.3, -0.2, 0.3, 1.5, 0.1, -0.2, 0.1, 1.0);
        let (moments, axes) = principal(&tensor);
        let r = axes.to_rotation_matrix();
        let back = r.matrix() * Matrix3::from_diagonal(&moments.into()) * r.matrix().transpose();
        assert!((back - tensor).norm() < 1e-12);
    }
}
