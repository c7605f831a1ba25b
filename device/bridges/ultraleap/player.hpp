// The queue of focal points, and the rule which of them a device sample gets (docs/formats/ultraleap-bridge.md, "Time").
//
// Two threads use a Player. The program's thread adds samples and asks to forget them; the library's thread, which calls
// back about a thousand times a second, takes them. The queue between the two needs no lock, and the library's thread
// neither allocates memory nor waits.
#pragma once

#include <algorithm>
#include <atomic>
#include <cmath>
#include <cstdint>
#include <vector>

namespace palpate {

struct Point {
  float x, y, z, intensity;  // [m] in the array's own frame, and 0..1
};

// Counts since the last `prepare`.
struct Counts {
  std::uint64_t taken = 0, begun = 0, passed = 0, dropped = 0;
  std::uint64_t dry_times = 0, dry_device_samples = 0, missed_callbacks = 0, device_samples = 0;
  float greatest_intensity = 0;  // of the points of the device sample that was handed over last
  bool is_finished = false;      // the sample that `finish_after` names was played to its end

  std::uint64_t waiting() const { return taken - begun - passed - dropped; }
};

class Player {
 public:
  static constexpr std::uint64_t capacity = 65536;  // samples; 1.6 s at 40 kHz
  static constexpr double hold = 0.1;               // seconds for which the last sample is held when no next one waits

  // Empties the queue and sets counts to 0. The library must be stopped; if it calls back nevertheless, `begin_interval`
  // answers false.
  void prepare(unsigned point_count, double rate, double device_rate) {
    while (is_in_use_.test_and_set(std::memory_order_acquire)) {
    }
    point_count_ = point_count;
    rate_ = rate;
    device_step_ = 1 / device_rate;
    samples_.assign(capacity * point_count, Point{0, 0, 0, 0});
    shown_.assign(point_count, Point{0, 0, 0, 0});
    counts_ = Counts();
    state_ = State::waits;
    taken_.store(0);
    used_.store(0);
    forget_before_.store(0);
    forget_asked_.store(0);
    forget_done_.store(0);
    last_sample_.store(never);
    is_closed_ = false;
    publish();
    is_in_use_.clear(std::memory_order_release);
  }

  unsigned point_count() const { return point_count_; }

  // The program's thread.

  std::uint64_t room() const { return capacity - (taken_.load() - used_.load(std::memory_order_acquire)); }

  // Adds samples, at most `room()`; `points` are those of the first sample, those of the second, and so on.
  void add(const Point* points, std::uint64_t sample_count) {
    std::uint64_t taken = taken_.load();
    for (std::uint64_t k = 0; k < sample_count; ++k, points += point_count_)
      std::copy(points, points + point_count_, slot(taken + k));
    taken_.store(taken + sample_count, std::memory_order_release);
  }

  // Names the number of samples after which silence is the end, and not a queue that ran dry.
  void finish_after(std::uint64_t sample_count) { last_sample_.store(sample_count); }

  // Asks the library's thread to forget all samples that were added so far, and to hand over silence.
  void forget() {
    forget_before_.store(taken_.load());
    forget_asked_.store(forget_asked_.load() + 1, std::memory_order_release);
  }

  // Whether silence was handed over for as long as an interval since `forget`.
  bool is_forgotten() const { return forget_done_.load(std::memory_order_acquire) == forget_asked_.load(); }

  // Says that the library was stopped: what still waits counts as dropped.
  void close() { is_closed_ = true; }

  Counts counts() const {
    Counts found;
    std::uint64_t before, after;
    do {  // again if the library's thread wrote meanwhile, which takes it less than a microsecond
      before = version_.load();
      found.begun = published_[0].load();
      found.passed = published_[1].load();
      found.dropped = published_[2].load();
      found.dry_times = published_[3].load();
      found.dry_device_samples = published_[4].load();
      found.missed_callbacks = published_[5].load();
      found.device_samples = published_[6].load();
      found.is_finished = published_[7].load() != 0;
      found.greatest_intensity = published_intensity_.load();
      after = version_.load();
    } while (before != after || before % 2 != 0);
    found.taken = taken_.load();
    if (is_closed_) {
      found.dropped += found.waiting();
      found.greatest_intensity = 0;
    }
    return found;
  }

  // The library's thread: begin_interval; next for each device sample; end_interval.

  bool begin_interval() {
    if (is_in_use_.test_and_set(std::memory_order_acquire)) return false;
    forget_seen_ = forget_asked_.load(std::memory_order_acquire);
    if (forget_seen_ != forget_done_.load()) {
      std::uint64_t used = used_.load(), before = forget_before_.load();
      if (before > used) {
        counts_.dropped += before - used;
        used_.store(before, std::memory_order_release);
      }
      state_ = State::waits;
      silence();
    }
    return true;
  }

  // The points of the device sample that is due at `time` [s], which counts from any moment.
  const Point* next(double time) {
    if (counts_.device_samples > 0 && time - last_time_ > 1.5 * device_step_) ++counts_.missed_callbacks;
    last_time_ = time;
    ++counts_.device_samples;
    std::uint64_t waiting = taken_.load(std::memory_order_acquire) - used_.load();
    if (state_ == State::plays)
      go_on(time, waiting);
    else if (waiting > 0)
      begin(time);
    if (state_ == State::is_dry) {
      ++counts_.dry_device_samples;
      if (time - dry_since_ > hold - 0.5 * device_step_) silence();
    }
    return shown_.data();
  }

  void end_interval() {
    publish();
    forget_done_.store(forget_seen_, std::memory_order_release);
    is_in_use_.clear(std::memory_order_release);
  }

 private:
  enum class State { waits, plays, is_dry };
  static constexpr std::uint64_t never = UINT64_MAX;

  Point* slot(std::uint64_t sample) { return samples_.data() + (sample % capacity) * point_count_; }

  void silence() {
    for (Point& point : shown_) point.intensity = 0;
  }

  // Begins the next sample of the queue at `time`, from which the times of those that follow count.
  void begin(double time) {
    state_ = State::plays;
    begin_time_ = time;
    current_ = 0;
    show_next();
  }

  void show_next() {
    std::uint64_t used = used_.load();
    const Point* next = slot(used);
    for (unsigned i = 0; i < point_count_; ++i) {
      if (next[i].intensity > 0)
        shown_[i] = next[i];
      else
        shown_[i].intensity = 0;  // a silent point stays where it was
    }
    used_.store(used + 1, std::memory_order_release);
    ++counts_.begun;
  }

  // Holds the current sample, or begins the one whose time it is. The half device sample keeps rounding of times from
  // leaving one out, or from playing one twice.
  void go_on(double time, std::uint64_t waiting) {
    double due = std::floor((time + 0.5 * device_step_ - begin_time_) * rate_);
    if (!(due > static_cast<double>(current_))) return;
    std::uint64_t ahead = static_cast<std::uint64_t>(due) - current_;
    std::uint64_t late = std::min(ahead - 1, waiting);  // their time is over: the library left device samples out
    counts_.passed += late;
    current_ += late;
    used_.store(used_.load() + late, std::memory_order_release);
    if (waiting >= ahead) {
      ++current_;
      show_next();
    } else if (used_.load() == last_sample_.load()) {
      state_ = State::waits;
      counts_.is_finished = true;
      silence();
    } else if (greatest_intensity() == 0) {
      state_ = State::waits;  // a pause that was meant, not a queue that ran dry
    } else {
      state_ = State::is_dry;
      dry_since_ = begin_time_ + static_cast<double>(current_ + 1) / rate_;
      ++counts_.dry_times;
    }
  }

  float greatest_intensity() const {
    float greatest = 0;
    for (const Point& point : shown_) greatest = std::max(greatest, point.intensity);
    return greatest;
  }

  void publish() {
    version_.store(version_.load() + 1);
    published_[0].store(counts_.begun);
    published_[1].store(counts_.passed);
    published_[2].store(counts_.dropped);
    published_[3].store(counts_.dry_times);
    published_[4].store(counts_.dry_device_samples);
    published_[5].store(counts_.missed_callbacks);
    published_[6].store(counts_.device_samples);
    published_[7].store(counts_.is_finished ? 1 : 0);
    published_intensity_.store(greatest_intensity());
    version_.store(version_.load() + 1);
  }

  std::atomic_flag is_in_use_ = ATOMIC_FLAG_INIT;  // by `prepare`, or by an interval
  unsigned point_count_ = 1;
  double rate_ = 1, device_step_ = 1;  // [Hz] of the samples, [s] between device samples

  std::vector<Point> samples_;
  std::atomic<std::uint64_t> taken_{0}, used_{0};  // samples that were added to the queue, and taken from it, in all
  std::atomic<std::uint64_t> forget_before_{0}, forget_asked_{0}, forget_done_{0}, last_sample_{never};
  bool is_closed_ = true;  // of the program's thread

  // Of the library's thread.
  State state_ = State::waits;
  std::vector<Point> shown_;
  Counts counts_;
  double begin_time_ = 0, last_time_ = 0, dry_since_ = 0;
  std::uint64_t current_ = 0, forget_seen_ = 0;

  std::atomic<std::uint64_t> version_{0};  // odd while counts are written
  std::atomic<std::uint64_t> published_[8] = {};
  std::atomic<float> published_intensity_{0};
};

}  // namespace palpate
