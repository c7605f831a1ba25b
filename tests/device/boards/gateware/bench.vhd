-- The board's two published entities behind a chip that passes on a byte every CHIP_CLOCKS clocks while the board is ready.
-- Reads lines "clock byte" from INPUT: from which clock on the byte is on the bus. Writes a line for each frame swapped in:
-- the clock, the divider, 256 phases, 256 amplitudes.
library ieee;
use ieee.std_logic_1164.all;
use ieee.numeric_std.all;
use std.textio.all;

entity bench is
  generic (
    INPUT       : string  := "bytes.txt";
    OUTPUT      : string  := "frames.txt";
    CHIP_CLOCKS : natural := 5;
    END_CLOCK   : natural := 1000000);
end bench;

architecture test of bench is
  constant PERIOD_CLOCKS : natural := 1250;  -- of the carrier: 25 us at 50 MHz
  signal clk, new_rx, timing, ready, byte_in, t_en, t_flag, t_pswap, t_aswap, rgb_en : std_logic := '0';
  signal rx_data, q_in, divider, t_address : std_logic_vector(7 downto 0) := (others => '0');
  signal t_data : std_logic_vector(6 downto 0);
  signal rgb_data : std_logic_vector(23 downto 0);
  signal debug_a, debug_b : std_logic_vector(3 downto 0);
  signal now_clock : natural := 0;
begin
  buffer_controller : entity work.FrameBufferController
    port map (clk => clk, new_rx => new_rx, rx_data => rx_data, timing => timing, divider => divider, ready => ready,
              byte_in => byte_in, q_in => q_in, debugled => debug_a);
  reader : entity work.CommandReader
    port map (clk => clk, byte_in => byte_in, q_in => q_in, divider => divider, t_en => t_en, t_flag => t_flag,
              t_data => t_data, t_address => t_address, t_pswap => t_pswap, t_aswap => t_aswap, rgb_data => rgb_data,
              rgb_en => rgb_en, debugled => debug_b);

  process
  begin
    while now_clock < END_CLOCK loop
      clk <= '1'; wait for 10 ns; clk <= '0'; wait for 10 ns;
      now_clock <= now_clock + 1;
    end loop;
    wait;
  end process;

  timing <= '1' when now_clock mod PERIOD_CLOCKS >= PERIOD_CLOCKS / 2 else '0';

  process
    file source : text open read_mode is INPUT;
    variable row : line;
    variable from_clock, value, sent_clock : integer := 0;
  begin
    while not endfile(source) loop
      readline(source, row);
      read(row, from_clock);
      read(row, value);
      while now_clock < from_clock or now_clock < sent_clock + CHIP_CLOCKS or ready = '0' loop
        wait until rising_edge(clk);
        new_rx <= '0';
      end loop;
      rx_data <= std_logic_vector(to_unsigned(value, 8));
      new_rx <= '1';
      sent_clock := now_clock;
      wait until rising_edge(clk);
      new_rx <= '0';
    end loop;
    wait;
  end process;

  process (clk)
    type bytes_t is array (0 to 255) of natural;
    variable phase, amplitude : bytes_t := (others => 0);
    file sink : text open write_mode is OUTPUT;
    variable row : line;
  begin
    if rising_edge(clk) then
      if t_en = '1' and t_flag = '0' then
        phase(to_integer(unsigned(t_address))) := to_integer(unsigned(t_data));
      elsif t_en = '1' then
        amplitude(to_integer(unsigned(t_address))) := to_integer(unsigned(t_data));
      end if;
      if t_pswap = '1' then
        write(row, now_clock);
        write(row, string'(" "));
        write(row, to_integer(unsigned(divider)));
        for pin in 0 to 255 loop
          write(row, string'(" "));
          write(row, phase(pin));
        end loop;
        for pin in 0 to 255 loop
          write(row, string'(" "));
          write(row, amplitude(pin));
        end loop;
        writeline(sink, row);
      end if;
    end if;
  end process;
end test;
