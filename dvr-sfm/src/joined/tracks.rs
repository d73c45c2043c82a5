//! Tracks: features of several pictures that show one point, from matches of two pictures each.

use glam::DVec2;

use crate::database::Matches;

/// A feature of a picture.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Feature {
    /// Which of the pictures.
    pub picture: usize,
    /// Where it is, pixels from the upper left corner of the picture.
    pub place: DVec2,
}

/// What matches connect, each with two features or more, of different pictures: of a picture that a track shows twice,
/// nobody knows which is right, and both are left out.
pub(super) fn tracks(found: &Matches) -> Vec<Vec<Feature>> {
    let mut first = Vec::with_capacity(found.pictures.len());
    let mut count = 0;
    for picture in &found.pictures {
        first.push(count);
        count += picture.places.len();
    }
    let mut sets = DisjointSets::of(count);
    for pair in &found.pairs {
        let [a, b] = pair.pictures.map(|picture| first[picture]);
        for matched in &pair.matches {
            sets.join(a + matched[0], b + matched[1]);
        }
    }
    let mut of_root: Vec<Vec<Feature>> = vec![Vec::new(); count];
    for (picture, features) in found.pictures.iter().enumerate() {
        for (i, place) in features.places.iter().enumerate() {
            of_root[sets.root(first[picture] + i)].push(Feature { picture, place: *place });
        }
    }
    let of_different_pictures = |track: Vec<Feature>| -> Vec<Feature> {
        // Features of a picture follow each other.
        track.chunk_by(|a, b| a.picture == b.picture).filter(|same| same.len() == 1).flatten().copied().collect()
    };
    of_root.into_iter().map(of_different_pictures).filter(|track| track.len() >= 2).collect()
}

/// Sets that grow together (Tarjan and van Leeuwen, *Worst-case Analysis of Set Union Algorithms*, 1984).
struct DisjointSets(Vec<usize>);

impl DisjointSets {
    fn of(count: usize) -> Self {
        Self((0..count).collect())
    }

    fn root(&mut self, mut of: usize) -> usize {
        while self.0[of] != of {
            self.0[of] = self.0[self.0[of]];
            of = self.0[of];
        }
        of
    }

    fn join(&mut self, a: usize, b: usize) {
        let (a, b) = (self.root(a), self.root(b));
        self.0[a.max(b)] = a.min(b);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::database::{Features, Pair};

    #[test]
    fn matches_of_two_pictures_become_tracks_of_many() {
        let features = |name: &str, count: usize| Features {
            name: name.to_owned(),
            places: (0..count).map(|i| DVec2::splat(i as f64)).collect(),
        };
        let pair = |a: usize, b: usize, matches: &[[usize; 2]]| Pair { pictures: [a, b], matches: matches.to_vec() };
        let found = Matches {
            pictures: vec![features("a", 3), features("b", 3), features("c", 3), features("d", 1)],
            pairs: vec![
                pair(2, 3, &[[2, 0]]),
                pair(0, 1, &[[0, 1], [2, 2], [1, 0]]),
                pair(1, 2, &[[1, 2], [2, 1], [2, 0]]),
            ],
        };
        let tracks = tracks(&found);
        let named: Vec<Vec<(usize, f64)>> = tracks
            .iter()
            .map(|track| track.iter().map(|feature| (feature.picture, feature.place.x)).collect())
            .collect();
        assert_eq!(
            named,
            [vec![(0, 0.0), (1, 1.0), (2, 2.0), (3, 0.0)], vec![(0, 1.0), (1, 0.0)], vec![(0, 2.0), (1, 2.0)]],
            "of c, the last track shows two features"
        );
    }
}
