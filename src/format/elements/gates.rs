//! The directed edges of coded elements behind which another may lie.

/// An edge `a → b` of a coded element; an element behind it runs `b → a`.
#[derive(Clone, Copy, Debug)]
pub(super) struct Gate {
    pub a: u32,
    pub b: u32,
    /// The corner before `a` in its element.
    pub before: u32,
    /// The corner after `b` in its element.
    pub after: u32,
}

/// The far ends of open gates beside the next corner, which it probably is.
#[derive(Clone, Copy, Debug)]
pub(super) struct Closing {
    /// `x` of an open gate `x → last corner`.
    pub left: Option<u32>,
    /// `y` of an open gate `first corner → y`, where the next corner is the last one.
    pub right: Option<u32>,
}

impl Closing {
    /// 0: none, 1: one, 2: two that differ, 3: two that agree.
    pub(super) fn context(&self) -> usize {
        match (self.left, self.right) {
            (None, None) => 0,
            (Some(l), Some(r)) => 2 + (l == r) as usize,
            _ => 1,
        }
    }
}

const NONE: u32 = u32::MAX;

/// How many open gates of a vertex are looked at, at most.
const LOOK: usize = 12;

#[derive(Clone, Copy, Debug)]
struct Entry {
    gate: Gate,
    open: bool,
    /// The next older gate from `a`, and to `b`.
    next: [u32; 2],
}

/// All gates, a queue of the open ones, and for each vertex the lists of gates from and to it, newest first.
#[derive(Debug)]
pub(super) struct Gates {
    entries: Vec<Entry>,
    cursor: usize,
    heads: [Vec<u32>; 2],
    open: Vec<u32>,
    touched: Vec<bool>,
}

impl Gates {
    pub(super) fn new(vertices: usize) -> Self {
        Gates {
            entries: Vec::new(),
            cursor: 0,
            heads: [vec![NONE; vertices], vec![NONE; vertices]],
            open: vec![0; vertices],
            touched: vec![false; vertices],
        }
    }

    /// The oldest open gate, which is closed by this.
    pub(super) fn pop(&mut self) -> Option<Gate> {
        while self.cursor < self.entries.len() {
            self.cursor += 1;
            if self.entries[self.cursor - 1].open {
                return Some(self.close(self.cursor - 1));
            }
        }
        None
    }

    fn close(&mut self, entry: usize) -> Gate {
        let e = &mut self.entries[entry];
        e.open = false;
        self.open[e.gate.a as usize] -= 1;
        self.open[e.gate.b as usize] -= 1;
        e.gate
    }

    /// Whether elements name `v` and no open gate does.
    pub(super) fn finished(&self, v: u32) -> bool {
        self.touched[v as usize] && self.open[v as usize] == 0
    }

    /// The newest open gates from (`side` 0) or to (`side` 1) `v` that `fits` accepts. Closed ones on the way are taken
    /// out of the list, so that the work is paid for by the gates opened.
    fn find(&mut self, side: usize, v: u32, fits: impl Fn(&Gate) -> bool) -> Option<usize> {
        let (mut previous, mut at, mut looked) = (NONE, self.heads[side][v as usize], 0);
        while at != NONE && looked < LOOK {
            let entry = self.entries[at as usize];
            if entry.open {
                if fits(&entry.gate) {
                    return Some(at as usize);
                }
                looked += 1;
                previous = at;
            } else if previous == NONE {
                self.heads[side][v as usize] = entry.next[side];
            } else {
                self.entries[previous as usize].next[side] = entry.next[side];
            }
            at = entry.next[side];
        }
        None
    }

    /// What may close an element whose known corners begin with `first` and end with `last`.
    pub(super) fn closing(&mut self, first: u32, last: u32, is_final: bool) -> Closing {
        let left = self.find(1, last, |g| g.a != first).map(|e| self.entries[e].gate.a);
        let right = if is_final { self.find(0, first, |g| g.b != last).map(|e| self.entries[e].gate.b) } else { None };
        Closing { left, right }
    }

    /// Note an element of degree ≥ 2: its edges close the gates that they lie behind, or open new ones. The first edge of
    /// an element that came through a gate is that gate's.
    pub(super) fn insert(&mut self, element: &[u32], gated: bool) {
        let n = element.len();
        for &v in element {
            self.touched[v as usize] = true;
        }
        if n < 3 {
            return;
        }
        for k in gated as usize..n {
            let (a, b) = (element[k], element[(k + 1) % n]);
            if let Some(entry) = self.find(0, b, |g| g.b == a) {
                self.close(entry);
                continue;
            }
            let gate = Gate { a, b, before: element[(k + n - 1) % n], after: element[(k + 2) % n] };
            let number = self.entries.len() as u32;
            let next = [self.heads[0][a as usize], self.heads[1][b as usize]];
            self.entries.push(Entry { gate, open: true, next });
            self.heads[0][a as usize] = number;
            self.heads[1][b as usize] = number;
            self.open[a as usize] += 1;
            self.open[b as usize] += 1;
        }
    }
}
