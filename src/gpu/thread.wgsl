// The entry point of a kernel whose `work` is that of the thread of a number, which may be beyond all work.
@compute @workgroup_size(64)
fn main(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    work((group.y * groups.x + group.x) * 64u + local);
}
