//! Object stores as blocking calls: S3, Google Cloud Storage and Azure, through the `object_store` crate.
//!
//! Credentials, endpoints and other options come from the environment as that crate reads them (`AWS_*`, `GOOGLE_*`,
//! `AZURE_*`). It repeats a request that failed with 5xx, was cut or timed out, waiting longer each time; [`Retries`]
//! bounds that. What it leaves to its callers, lists and multipart uploads whose answer broke off in its body, is
//! repeated here ([`Store::again`]) within the same bounds. Downloads go in ranges under one entity tag, so that a
//! connection that breaks costs one range, and an object that changes on the way is an error and never a mixture.
//! Uploads are whole or not at all: one request up to [`MULTIPART_ABOVE`], and a multipart upload, completed last and
//! aborted on failure, beyond.

use super::error::{Failure, FailureKind, IngestError};
use futures_util::{StreamExt, TryStreamExt, stream};
use object_store::aws::{AmazonS3Builder, AmazonS3ConfigKey};
use object_store::azure::{AzureConfigKey, MicrosoftAzureBuilder};
use object_store::client::HttpError;
use object_store::gcp::{GoogleCloudStorageBuilder, GoogleConfigKey};
use object_store::list::{PaginatedListOptions, PaginatedListStore};
use object_store::path::Path;
use object_store::{
    BackoffConfig, ClientConfigKey, Error, GetOptions, GetRange, ObjectStore, ObjectStoreExt, PutPayload, RetryConfig,
};
use std::collections::HashMap;
use std::error::Error as _;
use std::ops::Range;
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tokio::runtime::{Handle, Runtime};

/// Bytes of one request of a download.
const RANGE: u64 = 8 << 20;
/// Requests of one download at a time.
const AT_ONCE: usize = 4;
/// Uploads above this go in parts.
pub const MULTIPART_ABOVE: usize = 64 << 20;
/// Bytes of a part; ten thousand of them make 320 GB.
const PART: usize = 32 << 20;

/// How long a failing store is asked again.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Retries {
    /// How often one request is repeated.
    pub times: u32,
    /// After this time since its first attempt a request is not repeated again.
    pub within: Duration,
    /// How long one request may take, its body included.
    pub timeout: Duration,
}

impl Default for Retries {
    fn default() -> Self {
        Retries { times: 10, within: Duration::from_secs(180), timeout: Duration::from_secs(60) }
    }
}

/// The longest wait between two attempts.
const LONGEST_WAIT: Duration = Duration::from_secs(15);

impl Retries {
    /// The wait after the first attempt; every further one is twice as long, up to [`LONGEST_WAIT`].
    fn first_wait(&self) -> Duration {
        Duration::from_millis(100).min(self.within / 16)
    }
}

/// The schemes of URLs that name a store.
pub(super) const SCHEMES: [&str; 3] = ["s3", "gs", "az"];

/// The threads of the stores, once there are any, and the stores by their URLs.
type Open = (Option<Runtime>, HashMap<String, Arc<Store>>);

/// The stores of a run, each opened once. Threads start with the first.
pub(super) struct Stores {
    retries: Retries,
    open: Mutex<Open>,
}

impl Stores {
    pub fn new(retries: Retries) -> Self {
        Stores { retries, open: Mutex::new((None, HashMap::new())) }
    }

    /// The store of a bucket or container, as in `s3://scans`.
    pub fn open(&self, scheme: &str, bucket: &str) -> Result<Arc<Store>, IngestError> {
        let url = format!("{scheme}://{bucket}");
        let mut open = self.open.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some(store) = open.1.get(&url) {
            return Ok(store.clone());
        }
        let fail = |e: &dyn std::fmt::Display| IngestError::Setup(format!("{url}: cannot be used: {}", one_line(e)));
        if open.0.is_none() {
            // Whoever has chosen a provider before us keeps it.
            let _ = rustls::crypto::ring::default_provider().install_default();
            let mut builder = tokio::runtime::Builder::new_multi_thread();
            open.0 = Some(builder.worker_threads(2).enable_all().build().map_err(|e| fail(&e))?);
        }
        let Some(handle) = open.0.as_ref().map(|r| r.handle().clone()) else {
            return Err(fail(&"no threads"));
        };
        let (inner, pages) = self.build(scheme, &url).map_err(|e| fail(&e))?;
        let store = Arc::new(Store { inner, pages, handle, url: url.clone(), retries: self.retries });
        open.1.insert(url, store.clone());
        Ok(store)
    }

    fn build(&self, scheme: &str, url: &str) -> Result<Sides, Error> {
        let Retries { times, within, timeout } = self.retries;
        let backoff = BackoffConfig { init_backoff: self.retries.first_wait(), max_backoff: LONGEST_WAIT, base: 2.0 };
        let retry = RetryConfig { backoff, max_retries: times as usize, retry_timeout: within };
        let timeout = format!("{} ms", timeout.as_millis());
        let key = ClientConfigKey::Timeout;
        Ok(match scheme {
            "gs" => both(
                GoogleCloudStorageBuilder::from_env()
                    .with_url(url)
                    .with_retry(retry)
                    .with_config(GoogleConfigKey::Client(key), timeout)
                    .build()?,
            ),
            "az" => both(
                MicrosoftAzureBuilder::from_env()
                    .with_url(url)
                    .with_retry(retry)
                    .with_config(AzureConfigKey::Client(key), timeout)
                    .build()?,
            ),
            _ => both(
                AmazonS3Builder::from_env()
                    .with_url(url)
                    .with_retry(retry)
                    .with_config(AmazonS3ConfigKey::Client(key), timeout)
                    .build()?,
            ),
        })
    }
}

/// A store as what holds objects and as what lists them in pages.
type Sides = (Arc<dyn ObjectStore>, Arc<dyn PaginatedListStore>);

fn both<S: ObjectStore + PaginatedListStore>(store: S) -> Sides {
    let store = Arc::new(store);
    (store.clone(), store)
}

/// One bucket or container.
pub(super) struct Store {
    inner: Arc<dyn ObjectStore>,
    pages: Arc<dyn PaginatedListStore>,
    handle: Handle,
    url: String,
    retries: Retries,
}

/// Size and entity tag of an object.
pub(super) struct Meta {
    pub size: u64,
    pub tag: Option<String>,
}

impl Store {
    /// The URL of a key.
    pub fn name(&self, key: &str) -> String {
        format!("{}/{key}", self.url)
    }

    fn path(&self, key: &str) -> Result<Path, Failure> {
        Path::parse(key).map_err(|e| {
            Failure::new(FailureKind::Name, format!("{}: this is no key: {}", self.name(key), one_line(&e)))
        })
    }

    fn failure(&self, key: &str, e: &Error) -> Failure {
        let name = self.name(key);
        match e {
            Error::NotFound { .. } => {
                Failure::new(FailureKind::Missing, format!("{name}: there is no such object; check the path"))
            }
            Error::PermissionDenied { .. } | Error::Unauthenticated { .. } => Failure::new(
                FailureKind::Permission,
                format!("{name}: the store refuses access; check the credentials in the environment"),
            ),
            Error::Precondition { .. } => {
                Failure::new(FailureKind::Store, format!("{name}: the object changed while it was read; run again"))
            }
            _ => {
                let advice = "run again with --resume when the store is well";
                Failure::new(FailureKind::Store, format!("{name}: the store failed: {}; {advice}", one_line(e)))
            }
        }
    }

    /// Size and tag of an object; `None` where there is none.
    pub fn head(&self, key: &str) -> Result<Option<Meta>, Failure> {
        let path = self.path(key)?;
        match self.handle.block_on(self.inner.head(&path)) {
            Ok(meta) => Ok(Some(Meta { size: meta.size, tag: meta.e_tag })),
            Err(Error::NotFound { .. }) => Ok(None),
            Err(e) => Err(self.failure(key, &e)),
        }
    }

    /// Do `work`, and do it again while its error is one of those, within the bounds of [`Retries`].
    async fn again<T>(
        &self,
        those: fn(&Error) -> bool,
        mut work: impl AsyncFnMut() -> Result<T, Error>,
    ) -> Result<T, Error> {
        let (start, mut wait) = (Instant::now(), self.retries.first_wait());
        let mut left = self.retries.times;
        loop {
            match work().await {
                Err(e) if those(&e) && left > 0 && start.elapsed() < self.retries.within => {
                    tokio::time::sleep(wait).await;
                    wait = (wait * 2).min(LONGEST_WAIT);
                    left -= 1;
                }
                result => return result,
            }
        }
    }

    /// A range of an object, under its tag.
    pub fn range(&self, key: &str, meta: &Meta, range: Range<u64>) -> Result<Vec<u8>, Failure> {
        let range = range.start..range.end.min(meta.size);
        if range.is_empty() {
            return Ok(Vec::new());
        }
        let path = self.path(key)?;
        let mut bytes = Vec::with_capacity((range.end - range.start) as usize);
        let starts: Vec<u64> = (range.start..range.end).step_by(RANGE as usize).collect();
        let pieces = stream::iter(starts).map(|start| {
            let options = GetOptions {
                range: Some(GetRange::Bounded(start..(start + RANGE).min(range.end))),
                if_match: meta.tag.clone(),
                ..GetOptions::default()
            };
            let path = &path;
            async move { self.inner.get_opts(path, options).await?.bytes().await }
        });
        let work = pieces.buffered(AT_ONCE).try_for_each(|piece| {
            bytes.extend_from_slice(&piece);
            std::future::ready(Ok(()))
        });
        self.handle.block_on(work).map_err(|e| self.failure(key, &e))?;
        if bytes.len() as u64 != range.end - range.start {
            let message = format!(
                "{}: the store gave {} bytes instead of {}",
                self.name(key),
                bytes.len(),
                range.end - range.start
            );
            return Err(Failure::new(FailureKind::Store, message));
        }
        Ok(bytes)
    }

    /// A whole object.
    pub fn get(&self, key: &str) -> Result<Vec<u8>, Failure> {
        let missing = Error::NotFound { path: key.to_string(), source: "".into() };
        let meta = self.head(key)?.ok_or_else(|| self.failure(key, &missing))?;
        self.range(key, &meta, 0..meta.size)
    }

    /// Put an object in its place, whole or not at all.
    pub fn put(&self, key: &str, bytes: Vec<u8>) -> Result<(), Failure> {
        let path = self.path(key)?;
        let parts: Vec<PutPayload> = if bytes.len() <= MULTIPART_ABOVE {
            vec![bytes.into()]
        } else {
            bytes.chunks(PART).map(|p| p.to_vec().into()).collect()
        };
        let whole = async {
            if let [whole] = &parts[..] {
                return self.inner.put(&path, whole.clone()).await.map(drop);
            }
            // Beginning and completing are not repeated by the crate; parts are, so their failure is final.
            let in_parts = async || {
                let mut upload = self.inner.put_multipart(&path).await?;
                let parts: Vec<_> = parts.iter().map(|p| upload.put_part(p.clone())).collect();
                let sent = stream::iter(parts).buffer_unordered(AT_ONCE).try_collect::<Vec<()>>().await;
                match sent {
                    Ok(_) => upload.complete().await.map(|_| Ok(())),
                    Err(e) => {
                        // There is an error to report already; a store that fails here too drops the parts by its own
                        // rules.
                        let _ = upload.abort().await;
                        Ok(Err(e))
                    }
                }
            };
            self.again(broke_off_anyhow, in_parts).await?
        };
        self.handle.block_on(whole).map_err(|e| self.failure(key, &e))
    }

    /// All objects below a prefix, in the order of their keys, as key and size.
    pub fn list(&self, prefix: &str, mut each: impl FnMut(&str, u64) -> bool) -> Result<(), Failure> {
        // Like a folder's name: what only begins with the same letters lies elsewhere.
        let below = if prefix.is_empty() { None } else { Some(format!("{}/", self.path(prefix)?)) };
        let mut token = None;
        loop {
            let work = self.again(broke_off, async || {
                let options = PaginatedListOptions { page_token: token.clone(), ..PaginatedListOptions::default() };
                self.pages.list_paginated(below.as_deref(), options).await
            });
            let page = self.handle.block_on(work).map_err(|e| self.failure(prefix, &e))?;
            for object in page.result.objects {
                if !each(object.location.as_ref(), object.size) {
                    return Ok(());
                }
            }
            token = page.page_token;
            if token.is_none() {
                return Ok(());
            }
        }
    }
}

/// Whether it is an answer that began well and then broke off, which the crate leaves to its callers (but for
/// downloads). Errors after its own attempts hold the same kind of error one step deeper.
fn broke_off(e: &Error) -> bool {
    let Error::Generic { source, .. } = e else { return false };
    source.source().is_some_and(|s| s.is::<HttpError>())
}

/// The same, at any depth: for requests that the crate does not repeat.
fn broke_off_anyhow(e: &Error) -> bool {
    std::iter::successors(e.source(), |&s| s.source()).any(|s| s.is::<HttpError>())
}

/// What the crate has to say, without the bodies of answers that it likes to quote.
fn one_line(e: &dyn std::fmt::Display) -> String {
    let text = e.to_string();
    let words: Vec<&str> = text.split_whitespace().collect();
    let line = words.join(" ");
    let end = line.char_indices().nth(300).map_or(line.len(), |(i, _)| i);
    line[..end].to_string()
}
