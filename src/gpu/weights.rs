//! The evaluator of edge weights on a device; twin of [`Cpu`](crate::encode::cost::Cpu).
//!
//! First the level on the device is made to follow the loop (`resident`). Then three stages, joined by bounded channels: the
//! processor's threads ask for runs of edges which are known already and list the others; one thread uploads them and
//! dispatches, two runs at a time, so that the device works on one while the results of the other come back; one thread
//! turns results into integers. Patches that the kernel does not take (large rings, hubs) are weighed by the processor at
//! the end.

use crossbeam_channel::{Receiver, Sender, bounded};
use rayon::prelude::*;
use std::collections::VecDeque;
use std::sync::Arc;

use super::buffers::{Growing, INPUT, Results, UNIFORM};
use super::device::Device;
use super::error::DeviceError;
use super::resident::Resident;
use super::shader::{CLASS, FOLDS, Kernel, OUTCOME, PARAMS, STARS, TOO_LARGE};
use super::window::{Window, cut};
use crate::encode::cost::{Class, EvaluateError, Evaluator, Fixed, Task, Weight, weigh_some};

/// Edges of a run.
const RUN: usize = 1 << 17;
/// Runs that are on their way at once.
const SLOTS: usize = 2;
/// Bytes that an edge takes on the device: ends, outcome, and the copy that comes back.
const EDGE_BYTES: u64 = 8 + 8 + 8;

/// Weighs edges on a device.
#[derive(Debug)]
pub struct GpuWeights {
    device: Device,
    kernels: Arc<Kernels>,
    level: Resident,
    slots: Vec<Slot>,
}

/// What is compiled once for a device.
#[derive(Debug)]
pub struct Kernels {
    weigh: Kernel,
    apply: Kernel,
}

impl Kernels {
    /// Compile.
    pub fn new(device: &Device) -> Result<Self, DeviceError> {
        Ok(Kernels { weigh: Kernel::new(device, "edge_weight", 3)?, apply: Kernel::new(device, "apply", 2)? })
    }
}

/// A run on its way.
#[derive(Debug)]
struct Slot {
    params: Growing,
    edges: Growing,
    results: Results,
}

/// A run of edges to be weighed.
struct Run<'o> {
    /// The number of the first edge of `out`.
    first: usize,
    out: &'o mut [Fixed],
    /// Places in `out` of the edges to be weighed.
    places: Vec<u32>,
    ends: Vec<[u32; 2]>,
    /// Where the level does not fit: what these edges need of it.
    window: Option<Window>,
}

impl GpuWeights {
    /// Compile the kernel on `device`.
    ///
    /// # Errors
    /// [`DeviceError`] when the shader is refused or memory runs out.
    pub fn new(device: Device) -> Result<Self, DeviceError> {
        let kernels = Arc::new(Kernels::new(&device)?);
        GpuWeights::on(device, kernels)
    }

    /// With kernels that are compiled already.
    pub(super) fn on(device: Device, kernels: Arc<Kernels>) -> Result<Self, DeviceError> {
        let level = Resident::new(&device);
        let slots = (0..SLOTS)
            .map(|_| Slot {
                params: Growing::new(&device, UNIFORM),
                edges: Growing::new(&device, INPUT),
                results: Results::new(&device),
            })
            .collect();
        device.check()?;
        Ok(GpuWeights { device, kernels, level, slots })
    }

    /// Edges of a run, and bytes of a level or window: what the budget and the limits allow. An upload passes through
    /// memory of the driver's, so that a level counts twice.
    fn plan(&self) -> (usize, u64) {
        let budget = self.device.budget();
        let run = (budget / 4 / (EDGE_BYTES * SLOTS as u64)).clamp(256, RUN as u64);
        (run as usize, (budget.saturating_sub(run * EDGE_BYTES * SLOTS as u64) / 2).max(1 << 14))
    }

    /// Weigh what is asked for; what the kernel does not take is weighed by the processor.
    pub(super) fn weigh_all(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, DeviceError> {
        let (weighed, left) = self.run(task, out)?;
        weigh_some(task, &left, out);
        Ok(weighed)
    }

    fn run(&mut self, task: &Task, out: &mut [Fixed]) -> Result<(u64, Vec<u32>), DeviceError> {
        let (run, most) = self.plan();
        let slots = self.level.follow(&self.device, &self.kernels.apply, task, most)?;
        let slots = slots.as_deref();
        let whole = slots.is_some();
        // A window's largest array is at most what it takes in all.
        let most = most.min(self.device.info.binding_bytes);
        let parts = task.parts(run, out);
        std::thread::scope(|scope| {
            let (to_device, runs) = bounded::<Run>(SLOTS);
            let (to_finish, done) = bounded::<(Run, Vec<[u32; 2]>)>(SLOTS);
            let on_device = scope.spawn(|| self.dispatch_all(task, runs, to_finish));
            let finish = scope.spawn(|| finish_all(task, done));
            let first_of = |vertices: &std::ops::Range<u32>| task.edges.from(vertices.start).start;
            let left: Vec<u32> = parts
                .into_par_iter()
                .flat_map_iter(|(vertices, out)| {
                    let first = first_of(&vertices);
                    let mut left = Vec::new();
                    let run = list(task, slots, vertices, first, out, &mut left);
                    let window = (!whole).then_some(most);
                    // Who no longer listens has an error to tell.
                    let _ = send(task, run, window, &to_device);
                    left
                })
                .collect();
            drop(to_device);
            let error = on_device.join().unwrap_or_else(|_| {
                Err(DeviceError::Failed {
                    device: "the device's thread".to_string(),
                    reason: "it panicked".to_string(),
                })
            });
            let (weighed, mut more) = finish.join().unwrap_or_default();
            error?;
            more.extend(left);
            more.sort_unstable();
            Ok((weighed + more.len() as u64, more))
        })
    }

    /// The thread that talks to the device.
    fn dispatch_all<'o>(
        &mut self,
        task: &Task,
        runs: Receiver<Run<'o>>,
        done: Sender<(Run<'o>, Vec<[u32; 2]>)>,
    ) -> Result<(), DeviceError> {
        let GpuWeights { device, kernels, level, slots } = self;
        let mut on_their_way: VecDeque<(usize, Run)> = VecDeque::new();
        let mut free: Vec<usize> = (0..slots.len()).collect();
        let come_back =
            |on_their_way: &mut VecDeque<(usize, Run<'o>)>, free: &mut Vec<usize>, slots: &mut Vec<Slot>| {
                let Some((slot, run)) = on_their_way.pop_front() else { return Ok(true) };
                let mut span = task.trace.span("device: weigh", "wait for edge_weight");
                span.items(run.places.len() as u64);
                let outcomes = slots[slot].results.wait(device)?;
                free.push(slot);
                Ok(done.send((run, outcomes)).is_ok())
            };
        for run in runs {
            if free.is_empty() && !come_back(&mut on_their_way, &mut free, slots)? {
                return Ok(());
            }
            let Some(slot) = free.pop() else { return Err(device.failed("no run ended")) };
            let mut span = task.trace.span("device: upload", "upload edges");
            span.items(run.places.len() as u64);
            let at = &mut slots[slot];
            if let Some(window) = &run.window {
                level.put_window(device, &window.stars);
            }
            let params: [u32; PARAMS] = [run.places.len() as u32, 0, 0, 0];
            at.params.put(device, &params);
            let ends = run.window.as_ref().map_or(&run.ends, |w| &w.edges);
            at.edges.put(device, bytemuck::cast_slice(ends));
            let mut inputs = vec![at.params.binding(0)];
            inputs.extend(level.bindings(1));
            inputs.push(at.edges.binding(3));
            drop(span);
            // A software device works here, a real one only hears of the work.
            let mut span = task.trace.span("device: weigh", "submit edge_weight");
            span.items(run.places.len() as u64);
            at.results.dispatch(device, &kernels.weigh, &inputs, run.places.len(), OUTCOME)?;
            drop(span);
            on_their_way.push_back((slot, run));
        }
        while !on_their_way.is_empty() {
            if !come_back(&mut on_their_way, &mut free, slots)? {
                break;
            }
        }
        Ok(())
    }
}

impl Evaluator for GpuWeights {
    fn name(&self) -> String {
        self.device.info().name.clone()
    }

    fn beside(&self) -> bool {
        true
    }

    fn weigh(&mut self, task: &Task, out: &mut [Fixed]) -> Result<u64, EvaluateError> {
        self.weigh_all(task, out).map_err(|e| EvaluateError(Box::new(e)))
    }
}

/// Write what is known of the edges whose smaller ends are `vertices`, list what has to be weighed; `left` gets the numbers of edges at
/// stars that no kernel takes. With `slots` edges are listed by those.
fn list<'o>(
    task: &Task,
    slots: Option<&[u32]>,
    vertices: std::ops::Range<u32>,
    first: usize,
    out: &'o mut [Fixed],
    left: &mut Vec<u32>,
) -> Run<'o> {
    let mut span = task.trace.work("list edges to weigh");
    let (mut places, mut ends) = (Vec::new(), Vec::new());
    let star = |v: u32| task.level.star.get(v).len();
    let mut place = 0;
    for a in vertices {
        for &b in task.edges.larger(a) {
            match task.known(a, b) {
                Some(weight) => out[place] = weight,
                None if star(a) + star(b) > STARS => left.push((first + place) as u32),
                None => {
                    places.push(place as u32);
                    ends.push(slots.map_or([a, b], |s| [s[a as usize], s[b as usize]]));
                }
            }
            place += 1;
        }
    }
    span.items(places.len() as u64);
    Run { first, out, places, ends, window: None }
}

/// Send a run on its way; with `window`, in as many pieces as it takes to stay within so many bytes each.
fn send<'o>(task: &Task, run: Run<'o>, window: Option<u64>, to: &Sender<Run<'o>>) -> Result<(), ()> {
    let Some(most) = window else {
        return if run.places.is_empty() { Ok(()) } else { to.send(run).map_err(drop) };
    };
    let Run { mut first, mut out, places, ends, .. } = run;
    let mut from = 0;
    // Places count from the first edge of the whole run.
    let mut offset = 0;
    while from < ends.len() {
        let (window, taken) = {
            let mut span = task.trace.work("cut a window");
            let cut = cut(&task.level, &ends[from..], most);
            span.items(cut.1 as u64);
            cut
        };
        let to_place = places.get(from + taken).map_or(out.len(), |&p| p as usize - offset);
        let (part, rest) = out.split_at_mut(to_place);
        let part = Run {
            first,
            out: part,
            places: places[from..from + taken].iter().map(|&p| p - offset as u32).collect(),
            ends: Vec::new(),
            window: Some(window),
        };
        to.send(part).map_err(drop)?;
        out = rest;
        first += to_place;
        offset += to_place;
        from += taken;
    }
    Ok(())
}

/// The thread that turns outcomes into weights: how many, and the edges that are left to the processor.
fn finish_all(task: &Task, done: Receiver<(Run, Vec<[u32; 2]>)>) -> (u64, Vec<u32>) {
    let mut left = Vec::new();
    let mut weighed = 0;
    for (run, outcomes) in done {
        let mut span = task.trace.span("results", "make integers");
        span.items(outcomes.len() as u64);
        for (&place, [value, kind]) in run.places.iter().zip(outcomes) {
            let class = match kind & CLASS {
                0 => Class::Ordinary,
                1 => Class::Breaking,
                2 => Class::Dangling,
                TOO_LARGE => {
                    left.push((run.first + place as usize) as u32);
                    continue;
                }
                _ => Class::Illegal,
            };
            weighed += 1;
            let weight = Weight { class, value: f32::from_bits(value), folds: kind & FOLDS != 0 };
            run.out[place as usize] = task.scale.fixed(weight);
        }
    }
    (weighed, left)
}
