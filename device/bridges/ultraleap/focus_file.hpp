// Files of focal points (docs/formats/focal-points.md), judged whole before a sample of them plays.
#pragma once

#include <cstdint>
#include <cstring>
#include <fstream>
#include <string>
#include <vector>

#include "server.hpp"
#include "session.hpp"

namespace palpate {

class FocusFile {
 public:
  explicit FocusFile(const std::string& path) : path_(path), file_(path, std::ios::binary) {
    if (!file_) throw Failure(path + " cannot be opened");
    std::uint8_t header[header_size_];
    file_.read(reinterpret_cast<char*>(header), header_size_);
    if (file_.gcount() < 8 || std::memcmp(header, "PALPATEF", 8) != 0)
      throw Failure(path + " is no file of focal points: it does not begin with PALPATEF "
                    "(palpate export FILE -o points.bin --to focal-points writes one)");
    if (file_.gcount() < header_size_)
      throw Failure(path + " ends within its header: it has " + std::to_string(file_.gcount()) + " bytes");
    std::uint32_t version = number_at<std::uint32_t>(header + 8);
    if (version != 1) throw Failure(path + " is of version " + std::to_string(version) + ": version 1 can be played");
    point_count_ = number_at<std::uint32_t>(header + 12);
    rate_ = number_at<double>(header + 16);
    sample_count_ = number_at<std::uint64_t>(header + 24);
    if (point_count_ < 1 || point_count_ > points_most)
      throw Failure(path + " has " + points_text(point_count_) + " a sample: 1 to " + std::to_string(points_most) +
                    " can be played");
    if (!(rate_ >= 1 && std::isfinite(rate_)))
      throw Failure(path + " has a rate of " + text_of(rate_) + " Hz, which must be 1 Hz or more");
    if (sample_count_ < 1) throw Failure(path + " has no samples");
    require_size();
    require_values();
  }

  unsigned point_count() const { return point_count_; }
  double rate() const { return rate_; }
  std::uint64_t sample_count() const { return sample_count_; }

  // Goes back to the first sample.
  void rewind() {
    file_.clear();
    file_.seekg(header_size_);
    next_ = 0;
  }

  // The next samples, at most so many; none at the end.
  std::uint64_t read(std::vector<Point>& points, std::uint64_t most) {
    std::uint64_t count = std::min(most, sample_count_ - next_);
    points.resize(count * point_count_);
    std::streamsize size = static_cast<std::streamsize>(points.size() * sizeof(Point));
    file_.read(reinterpret_cast<char*>(points.data()), size);
    if (file_.gcount() != size) throw Failure(path_ + " cannot be read on from sample " + std::to_string(next_));
    next_ += count;
    return count;
  }

 private:
  static constexpr int header_size_ = 32;

  void require_size() {
    file_.seekg(0, std::ios::end);
    std::streamoff end = file_.tellg();
    if (end < header_size_) throw Failure(path_ + " must be a file on a disk: of a pipe nobody knows the end before");
    std::uint64_t size = static_cast<std::uint64_t>(end) - header_size_;
    std::uint64_t sample_size = sizeof(Point) * point_count_, whole = size / sample_size, rest = size % sample_size;
    if (whole == sample_count_ && rest == 0) return;
    std::string found = std::to_string(whole) + " samples" + (rest > 0 ? " and " + std::to_string(rest) + " bytes" : "");
    throw Failure(path_ + " is damaged: its header says " + std::to_string(sample_count_) + " samples of " +
                  std::to_string(sample_size) + " bytes, and it holds " + found +
                  (rest > 0 && whole < sample_count_ ? ", so it ends within a sample" : ""));
  }

  void require_values() {
    std::vector<Point> points;
    rewind();
    for (std::uint64_t first = 0; std::uint64_t count = read(points, 4096); first += count) {
      try {
        require_playable(points.data(), count, point_count_, first);
      } catch (const Failure& failure) {
        throw Failure(path_ + ": " + failure.what());
      }
    }
  }

  std::string path_;
  std::ifstream file_;
  unsigned point_count_ = 0;
  double rate_ = 0;
  std::uint64_t sample_count_ = 0, next_ = 0;
};

// Plays a file so many times, each after the other without a pause; returns the exit code.
inline int play_file(FocusFile& file, std::uint64_t repeats, FocusArray& array, Player& player, Session& session) {
  double device_rate = session.set_up(file.point_count(), file.rate());
  ArrayInfo info = array.info();
  std::string times = repeats == 1 ? "once" : std::to_string(repeats) + " times";
  say("playing " + std::to_string(file.sample_count()) + " samples of " + points_text(file.point_count()) + " at " +
      text_of(file.rate()) + " Hz " + times + " on the array " + info.identifier + " (" + info.model + ", firmware " +
      info.firmware + "), " + sdk_name() + ", which takes " + text_of(device_rate) + " Hz");
  player.finish_after(file.sample_count() * repeats);
  std::vector<Point> points;
  std::uint64_t begun_times = 1;
  file.rewind();
  session.start();
  while (!EndSignal::came() && player.counts().device_samples == 0) {  // silence first, as for a client
    session.require_callbacks();
    sleep_a_millisecond();
  }
  while (!EndSignal::came() && !player.counts().is_finished) {
    for (std::uint64_t room; (room = player.room()) > 0;) {
      std::uint64_t count = file.read(points, std::min<std::uint64_t>(room, 4096));
      player.add(points.data(), count);
      if (count == 0 && begun_times == repeats) break;
      if (count == 0) ++begun_times, file.rewind();
    }
    session.require_callbacks();
    sleep_a_millisecond();
  }
  bool is_whole = player.counts().is_finished;
  session.off();
  if (!is_whole) say("a signal ended the playing before the end of the file");
  return is_whole ? 0 : 1;
}

}  // namespace palpate
