//! Vertices that no element uses.

use super::Mesh;

impl Mesh {
    /// Leave out the vertices that no element uses, with their values. Of a mesh without elements all stay: it is a set of
    /// points. Returns for each vertex its new number, `None` for one that is left out.
    pub fn drop_isolated(&mut self) -> Vec<Option<u32>> {
        self.retain_isolated(|_| false)
    }

    /// The same, but for those that `keep` names.
    pub fn retain_isolated(&mut self, keep: impl Fn(u32) -> bool) -> Vec<Option<u32>> {
        let count = self.positions.len();
        if self.corners.is_empty() {
            return (0..count as u32).map(Some).collect();
        }
        let mut used: Vec<bool> = (0..count as u32).map(keep).collect();
        self.corners.iter().for_each(|&v| used[v as usize] = true);
        let mut next = 0;
        let number: Vec<Option<u32>> = used
            .iter()
            .map(|&used| {
                next += u32::from(used);
                used.then(|| next - 1)
            })
            .collect();
        let mut kept = used.iter();
        self.positions.retain(|_| kept.next() == Some(&true));
        for v in &mut self.corners {
            // Every corner is one of a vertex in use.
            *v = number[*v as usize].unwrap_or(*v);
        }
        for layer in &mut self.layers {
            let renumbered = |&[v, value]: &[u32; 2]| Some([number[v as usize]?, value]);
            layer.isolated = layer.isolated.iter().filter_map(renumbered).collect();
        }
        number
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_what_no_element_uses_goes() {
        let mut mesh = Mesh { positions: (0..5).map(|i| [f64::from(i), 0.0, 0.0]).collect(), ..Mesh::default() };
        let mut points = mesh.clone();
        mesh.push_face(&[1, 3, 4]);
        assert_eq!(mesh.drop_isolated(), [None, Some(0), None, Some(1), Some(2)]);
        assert_eq!((mesh.positions[1], mesh.face(0)), ([3.0, 0.0, 0.0], &[0, 1, 2][..]));
        mesh.validate().unwrap();
        assert_eq!(points.drop_isolated().len(), 5);
        assert_eq!(points.positions.len(), 5);
    }
}
