// The bridge's side of the messages (docs/formats/ultraleap-bridge.md): one client at a time, by one thread that never
// waits for a client.
#pragma once

#include <cmath>
#include <cstdint>
#include <cstring>
#include <string>
#include <vector>

#include "session.hpp"
#include "system.hpp"

namespace palpate {

constexpr char magic[] = "PALPATEU";
constexpr std::uint32_t protocol_version = 1;
constexpr std::size_t header_size = 8, content_most = std::size_t{1} << 20;

template <class Number>
Number number_at(const std::uint8_t* bytes) {
  Number value;
  std::memcpy(&value, bytes, sizeof value);  // every machine that the vendor's library runs on is little-endian
  return value;
}

template <class Number>
void append(std::vector<std::uint8_t>& bytes, Number value) {
  const std::uint8_t* begin = reinterpret_cast<const std::uint8_t*>(&value);
  bytes.insert(bytes.end(), begin, begin + sizeof value);
}

inline void append_text(std::vector<std::uint8_t>& bytes, const std::string& text) {
  bytes.insert(bytes.end(), text.begin(), text.end());
}

// Throws if a point of these samples cannot be played; `first` is the number of the first one.
inline void require_playable(const Point* points, std::uint64_t sample_count, unsigned point_count, std::uint64_t first) {
  for (std::uint64_t i = 0; i < sample_count * point_count; ++i) {
    const float values[] = {points[i].x, points[i].y, points[i].z, points[i].intensity};
    const char* const names[] = {"x", "y", "z", "intensity"};
    for (int k = 0; k < 4; ++k) {
      bool is_finite = std::isfinite(values[k]);
      if (is_finite && (k < 3 || (values[k] >= 0 && values[k] <= 1))) continue;
      throw Failure("sample " + std::to_string(first + i / point_count) + ", point " + std::to_string(i % point_count) +
                    ": " + names[k] + " " + text_of(values[k]) + (is_finite ? " is outside 0..1" : " is not finite"));
    }
  }
}

// A connection: bytes in, until they are a message; bytes out, as far as the client takes them.
class Connection {
 public:
  Connection() = default;
  explicit Connection(Socket socket) : socket_(std::move(socket)), since_(seconds_now()), heard_(since_) {}

  explicit operator bool() const { return static_cast<bool>(socket_); }
  const Socket& socket() const { return socket_; }
  double since() const { return since_; }
  double heard() const { return heard_; }
  bool is_ended() const { return is_ended_; }
  bool holds_bytes() const { return !in_.empty(); }

  void hear() { heard_ = seconds_now(); }

  // Receives what is there: true if anything was.
  bool receive() {
    std::size_t before = in_.size();
    in_.resize(before + chunk);
    int got = socket_.receive(in_.data() + before, chunk);
    in_.resize(before + static_cast<std::size_t>(got > 0 ? got : 0));
    is_ended_ = is_ended_ || got < 0;
    if (got > 0) hear();
    return got > 0;
  }

  // Takes the next message, if all of it is there.
  bool take(std::string& name, std::vector<std::uint8_t>& content) {
    if (in_.size() < header_size) return false;
    name.assign(in_.begin(), in_.begin() + 4);
    std::size_t size = number_at<std::uint32_t>(in_.data() + 4);
    if (size > content_most)
      throw Failure("message " + readable(name) + " has " + std::to_string(size) + " bytes, which is more than " +
                    std::to_string(content_most));
    if (in_.size() < header_size + size) return false;
    auto begin = in_.begin() + header_size, end = begin + static_cast<std::ptrdiff_t>(size);
    content.assign(begin, end);
    in_.erase(in_.begin(), end);
    return true;
  }

  // The name that a message has so far, if four of its bytes are there.
  bool peek_name(std::string& name) const {
    if (in_.size() < 4) return false;
    name.assign(in_.begin(), in_.begin() + 4);
    return true;
  }

  void send(const char* name, const std::vector<std::uint8_t>& content) {
    append_text(out_, name);
    append(out_, static_cast<std::uint32_t>(content.size()));
    out_.insert(out_.end(), content.begin(), content.end());
    flush();
  }

  void fail(const std::string& sentence) { send("FAIL", std::vector<std::uint8_t>(sentence.begin(), sentence.end())); }

  void flush() {
    while (!out_.empty()) {
      int sent = socket_.send(out_.data(), out_.size());
      is_ended_ = is_ended_ || sent < 0;
      if (sent <= 0) return;
      out_.erase(out_.begin(), out_.begin() + sent);
    }
    if (is_closing_) socket_.end_sending();
  }

  bool has_unsent(std::size_t most) const { return out_.size() > most; }

  // Sends what is left, and reads what the client sends meanwhile: closing a socket that has unread bytes would take the
  // last message from the client.
  void begin_closing() {
    is_closing_ = true;
    since_ = seconds_now();
    in_.clear();
    flush();
  }

  // Whether a closing connection is over: the client ended it as well, or did not within a second.
  bool is_closed() {
    for (int i = 0; i < 16 && receive(); ++i) in_.clear();
    if (!out_.empty()) flush();
    return is_ended_ || seconds_now() - since_ > 1;
  }

  static std::string readable(const std::string& name) {
    std::string text = "'";
    for (char letter : name) text += letter >= ' ' && letter <= '~' ? letter : '?';
    return text + "'";
  }

 private:
  static constexpr std::size_t chunk = 65536;

  Socket socket_;
  std::vector<std::uint8_t> in_, out_;
  double since_ = 0, heard_ = 0;
  bool is_ended_ = false, is_closing_ = false;
};

class Server {
 public:
  Server(FocusArray& array, Player& player, Session& session) : array_(array), player_(player), session_(session) {}

  // Serves clients until a signal comes, or the first one is gone; returns the exit code.
  int serve(const std::string& address, unsigned port, bool is_once) {
    bool is_loopback = false;
    Socket listener = Socket::listen(address, port, is_loopback);
    ArrayInfo info = array_.info();
    say("listening at " + address + " port " + std::to_string(listener.local_port()) + " for the array " +
        info.identifier + " (" + info.model + ", firmware " + info.firmware + "), " + sdk_name() +
        "; focal points, and samples a second at most: " + session_.rates_text());
    if (!is_loopback)
      say("warning: " + address + " is no loopback address: whoever reaches this port can play on the array, since there "
          "is no password");
    while (!EndSignal::came() && !(is_once && is_client_gone_)) step(listener);
    if (client_) part("a signal ended palpate-ultraleap");
    while (!closing_.empty() && seconds_now() - closing_.back().since() < 0.2) step_closing(), sleep_a_millisecond();
    return is_once && is_client_gone_ && !is_client_good_ ? 1 : 0;
  }

 private:
  static constexpr double first_message_within = 2, heartbeat = 0.5;  // [s]
  static constexpr std::size_t unsent_most = 65536, closing_most = 16;

  void step(const Socket& listener) {
    std::vector<const Socket*> sockets{&listener};
    if (client_) sockets.push_back(&client_.socket());
    for (const Connection& connection : closing_) sockets.push_back(&connection.socket());
    Socket::wait(sockets, 20);
    if (client_) step_client();
    step_closing();
    while (Socket socket = listener.accept()) greet(Connection(std::move(socket)));
  }

  void greet(Connection connection) {
    if (client_) {
      connection.fail("the array is in use by another client, " + client_.socket().peer());
      close(std::move(connection));
      return;
    }
    say("client " + connection.socket().peer() + " came");
    client_ = std::move(connection);
    has_greeted_ = false;
  }

  void close(Connection connection) {
    connection.begin_closing();
    if (closing_.size() < closing_most) closing_.push_back(std::move(connection));
  }

  void step_closing() {
    for (std::size_t i = 0; i < closing_.size();) {
      if (closing_[i].is_closed())
        closing_.erase(closing_.begin() + static_cast<std::ptrdiff_t>(i));
      else
        ++i;
    }
  }

  void step_client() {
    try {
      client_.flush();
      for (int i = 0; i < 64 && client_.receive(); ++i) {
        answer_messages();
        client_.hear();  // again, since an answer may take its time
        if (client_.has_unsent(unsent_most)) throw Failure("the client does not read its answers");
      }
      if (client_.is_ended()) {
        end_client(client_.holds_bytes() ? "its connection ended within a message" : "its connection ended");
        return;
      }
      judge_time();
    } catch (const std::exception& error) {
      part(error.what());
    }
  }

  void judge_time() {
    double now = seconds_now();
    if (!has_greeted_ && now - client_.since() > first_message_within)
      throw Failure("no HELO came within " + text_of(first_message_within) + " s");
    if (!session_.is_on()) return;
    session_.require_callbacks();
    Counts counts = player_.counts();
    if (now - client_.heard() > heartbeat && (counts.waiting() > 0 || counts.greatest_intensity > 0))
      throw Failure("nothing was heard from the client for " + text_of(heartbeat) +
                    " s while samples waited or sounded, so the array was switched off");
  }

  void answer_messages() {
    std::string name;
    if (!has_greeted_ && client_.peek_name(name) && name != "HELO")
      throw Failure("the first message is " + Connection::readable(name) +
                    " instead of HELO: is the client palpate's link to Ultraleap arrays?");
    std::vector<std::uint8_t> content;
    while (client_.take(name, content)) {
      if (!has_greeted_ || name == "HELO")
        answer_helo(content);
      else if (name == "OPEN")
        answer_open(content);
      else if (name == "FOCI")
        take_foci(content);
      else if (name == "PING")
        answer_state();
      else if (name == "STOP")
        session_.silence(), answer_state();
      else
        throw Failure("message " + Connection::readable(name) + " is unknown");
    }
  }

  void answer_helo(const std::vector<std::uint8_t>& content) {
    if (has_greeted_) throw Failure("HELO came a second time");
    if (content.size() != 12 || std::memcmp(content.data(), magic, 8) != 0)
      throw Failure(std::string("HELO is not that of palpate, which has ") + magic + " and a version in it");
    std::uint32_t version = number_at<std::uint32_t>(content.data() + 8);
    if (version != protocol_version)
      throw Failure("the client speaks version " + std::to_string(version) + " of the messages, and palpate-ultraleap version " +
                    std::to_string(protocol_version) + ": compile palpate-ultraleap from the palpate that you run");
    ArrayInfo info = array_.info();
    std::vector<std::uint8_t> answer;
    append_text(answer, magic);
    append(answer, protocol_version);
    append(answer, static_cast<std::uint32_t>(Player::capacity));
    append(answer, static_cast<std::uint32_t>(session_.points_most()));
    append(answer, std::uint32_t{0});
    append_text(answer, info.library + "\n" + info.identifier + "\n" + info.model);
    client_.send("HELO", answer);
    has_greeted_ = true;
  }

  void answer_open(const std::vector<std::uint8_t>& content) {
    if (content.size() != 16 || number_at<std::uint32_t>(content.data() + 4) != 0)
      throw Failure("OPEN must have 16 bytes: points a sample, 0 and a rate");
    std::uint32_t point_count = number_at<std::uint32_t>(content.data());
    double rate = number_at<double>(content.data() + 8);
    double device_rate = session_.set_up(point_count, rate);
    session_.start();
    say("opened: " + points_text(point_count) + " at " + text_of(rate) + " Hz; the library takes " + text_of(device_rate) +
        " Hz");
    std::vector<std::uint8_t> answer;
    append(answer, device_rate);
    client_.send("OPEN", answer);
  }

  void take_foci(const std::vector<std::uint8_t>& content) {
    if (!session_.is_on()) throw Failure("FOCI came before OPEN");
    std::size_t sample_size = sizeof(Point) * player_.point_count();
    if (content.size() % sample_size != 0)
      throw Failure("FOCI has " + std::to_string(content.size()) + " bytes, which is no whole number of samples of " +
                    std::to_string(sample_size) + " bytes");
    std::uint64_t count = content.size() / sample_size, room = player_.room();
    points_.resize(content.size() / sizeof(Point));
    if (count > 0) std::memcpy(points_.data(), content.data(), content.size());
    require_playable(points_.data(), count, player_.point_count(), player_.counts().taken);
    if (count > room)
      throw Failure("FOCI has " + std::to_string(count) + " samples, and the queue has room for " + std::to_string(room));
    player_.add(points_.data(), count);
  }

  void answer_state() {
    Counts counts = player_.counts();
    std::vector<std::uint8_t> answer;
    for (std::uint64_t value : {counts.taken, counts.begun, counts.passed, counts.dropped, counts.dry_times,
                                counts.dry_device_samples, counts.missed_callbacks, counts.device_samples})
      append(answer, value);
    append(answer, counts.greatest_intensity);
    client_.send("STAT", answer);
  }

  // Silence first, then the client learns why.
  void part(const std::string& sentence) {
    session_.off();
    client_.fail(sentence);
    say("client " + client_.socket().peer() + " was sent away: " + sentence);
    is_client_gone_ = is_client_gone_ || has_greeted_;
    is_client_good_ = false;
    close(std::move(client_));
    client_ = Connection();
  }

  void end_client(const std::string& reason) {
    session_.off();
    say("client went: " + reason);
    is_client_gone_ = is_client_gone_ || has_greeted_;
    is_client_good_ = !client_.holds_bytes();
    client_ = Connection();
  }

  FocusArray& array_;
  Player& player_;
  Session& session_;
  Connection client_;
  std::vector<Connection> closing_;
  std::vector<Point> points_;
  bool has_greeted_ = false, is_client_gone_ = false, is_client_good_ = false;
};

}  // namespace palpate
